"""The page of a run: one HTML file with its pictures inside, which needs nothing beside it."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

KINDS = {".png": "image/png", ".gif": "image/gif", ".svg": "image/svg+xml"}
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 70rem; margin: 2rem auto; padding: 0 1rem }
figure { display: inline-block; margin: 0 1rem 1.5rem 0; vertical-align: top; max-width: 100% }
figure img { max-width: 100%; max-height: 34rem; border: 1px solid #ddd }
figcaption, th { color: #666; font-weight: normal; text-align: left } pre { background: #f4f5f7; padding: .7rem; overflow-x: auto }
td, th { padding: .1rem 1.5rem .1rem 0; vertical-align: top }
"""


def write_page(path: Path, report: Mapping[str, Any]) -> None:
    """Writes the page of a report: summary, pictures, the command that repeats the run, options, versions."""
    title = f"teg demo {report['demo']}"
    figures = [_figure(Path(picture)) for picture in report["pictures"]]
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(title)}</title><style>{STYLE}</style>",
        f"<h1>{escape(title)}</h1>",
        *(f"<p>{escape(line)}</p>" for line in report["summary"]),
        *figures,
        f"<h2>The same again</h2><pre>{escape(report['command'])}</pre>",
        "<h2>Options</h2>" + _table(report["options"]),
        "<h2>Versions</h2>" + _table(report["versions"] | report["machine"]),
        "<p>All numbers are in run.json.</p></html>",
    ]
    path.write_text("\n".join(parts) + "\n", encoding="utf-8")


def _figure(picture: Path) -> str:
    data = base64.b64encode(picture.read_bytes()).decode("ascii")
    source = f"data:{KINDS[picture.suffix]};base64,{data}"
    return f'<figure><img src="{source}" alt="{escape(picture.stem)}"><figcaption>{escape(picture.name)}</figcaption></figure>'


def _table(values: Mapping[str, Any]) -> str:
    rows = "".join(f"<tr><th>{escape(str(k))}<td>{escape(str(v))}" for k, v in values.items() if v is not None)
    return f"<table>{rows}</table>"
