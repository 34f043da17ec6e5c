"""The page of a run: one HTML file with its pictures inside, which needs nothing beside it. Large pictures are smaller in it."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

KINDS = {".png": "image/png", ".gif": "image/gif", ".svg": "image/svg+xml"}
LARGEST, SIDE = 1_500_000, 1400
WIDE, NARROW = 1.5, 700
"""Pictures of at least this width over height have a row of their own, but for those of fewer pixels; and so has the first."""
SCALE = '<meta name=viewport content="width=device-width">'  # letters as large on telephones
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 72rem; margin: 1.5rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem; margin: 0 0 .6rem } h2 { font-size: 1.15rem; margin: 1.6rem 0 .4rem }
ul { padding-left: 1.1rem; margin: 0 0 1.2rem }
main { display: grid; grid-auto-flow: dense; grid-template-columns: repeat(auto-fill, minmax(min(100%, 21rem), 1fr)); gap: 1.2rem }
figure { margin: 0 } figure.wide { grid-column: 1 / -1 }
figure img { display: block; max-width: 100%; max-height: 44rem; border: 1px solid #ddd; box-sizing: border-box }
figcaption, th { color: #666; font-weight: normal; text-align: left } pre { background: #f4f5f7; padding: .7rem; white-space: pre-wrap }
td, th { padding: .1rem 1.5rem .1rem 0; vertical-align: top; overflow-wrap: anywhere } th { white-space: nowrap }
"""


def write_page(path: Path, report: Mapping[str, Any]) -> None:
    """Writes the page of a report: summary, pictures, the command that repeats the run, options, versions."""
    title = f"teg demo {report['demo']}"
    pictures = [Path(picture) for picture in report["pictures"] if not _is_heavy(Path(picture))]
    figures = [_figure(picture, picture == pictures[0] or _is_wide(picture)) for picture in pictures]
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8>{SCALE}<title>{escape(title)}</title><style>{STYLE}</style>",
        f"<h1>{escape(title)}</h1>",
        "<ul>" + "".join(f"<li>{escape(line)}" for line in report["summary"]) + "</ul>",
        "<main>",
        *figures,
        "</main>",
        f"<h2>The same again</h2><pre>{escape(report['command'])}</pre>",
        "<h2>Options</h2>" + _table(report["options"]),
        "<h2>Versions</h2>" + _table(report["versions"] | report["machine"]),
        "<p>All numbers are in run.json.</p></html>",
    ]
    path.write_text("\n".join(parts) + "\n", encoding="utf-8")


def _figure(picture: Path, is_wide: bool) -> str:
    kind, data = _embedded(picture)
    source = f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
    wide = " class=wide" if is_wide else ""
    return f'<figure{wide}><img src="{source}" alt="{escape(picture.stem)}"><figcaption>{escape(picture.name)}</figcaption></figure>'


def _is_heavy(picture: Path) -> bool:
    """Returns whether a picture is left out: a drawing of so many triangles that a browser would be slow."""
    return picture.suffix == ".svg" and picture.stat().st_size > 2 * LARGEST


def _is_wide(picture: Path) -> bool:
    """Returns whether a picture has a row of its own."""
    if picture.suffix == ".svg":
        return False
    from PIL import Image

    with Image.open(picture) as image:
        return bool(image.width >= max(WIDE * image.height, NARROW))


def _embedded(picture: Path) -> tuple[str, bytes]:
    """Returns the kind of a picture and its bytes; a PNG of more than `LARGEST` bytes as a JPEG of at most `SIDE` pixels a side."""
    if picture.suffix != ".png" or picture.stat().st_size <= LARGEST:
        return KINDS[picture.suffix], picture.read_bytes()
    from PIL import Image

    with Image.open(picture) as image:
        small = image.convert("RGB")
    small.thumbnail((SIDE, SIDE), Image.Resampling.LANCZOS)
    buffer = BytesIO()
    small.save(buffer, "JPEG", quality=92)
    return "image/jpeg", buffer.getvalue()


def _table(values: Mapping[str, Any]) -> str:
    rows = "".join(f"<tr><th>{escape(str(k))}<td>{escape(str(v))}" for k, v in values.items() if v is not None)
    return f"<table>{rows}</table>"
