"""The programs in the pages: what their code blocks print, and the blocks of output that say so.

    python docs/page_programs.py docs/tutorial.md docs/how-to/*.md       # writes the outputs anew

The Python blocks of a page are one program, run from top to bottom. A block of text directly after a Python block is the output of that
block: what it prints, the warnings that it causes, and the error that ends it. `tests/package/test_pages.py` compares.
"""

from __future__ import annotations

import contextlib
import io
import re
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teg.errors import TegError

BLOCK = re.compile(r"^```python\n(.*?)^```$(?:\n\n?^```(?:text)?\n(.*?)^```$)?", re.DOTALL | re.MULTILINE)
NUMBER = re.compile(r"-?\d+\.\d+(?:e[-+]\d+)?|-?\d+e[-+]\d+")


@dataclass(frozen=True)
class Block:
    """A Python block, the output that follows it (None: no block of text follows), and where they stand in the page."""

    code: str
    output: str | None
    start: int
    end: int


def blocks_of(page: str) -> list[Block]:
    """Returns the Python blocks of a page, in order."""
    return [Block(m[1], m[2], m.start(), m.end()) for m in BLOCK.finditer(page)]


def output_of(code: str, names: dict[str, Any], title: str = "page") -> str:
    """Returns what a block prints, then its warnings and the TegError that ends it, as Python shows them without their places."""
    out, ending = io.StringIO(), ""
    with warnings.catch_warnings(record=True) as caught, contextlib.redirect_stdout(out):
        warnings.simplefilter("always")
        try:
            exec(compile(code, title, "exec"), names)
        except TegError as error:
            ending = f"{type(error).__module__}.{type(error).__name__}: {error}\n"
    said = "".join(f"{w.category.__name__}: {w.message}\n" for w in caught)
    return out.getvalue() + said + ending


def rewritten(page: str, title: str) -> str:
    """Returns a page with each block of output written anew."""
    names: dict[str, Any] = {"__name__": "__main__"}
    parts, end = [], 0
    for block in blocks_of(page):
        printed = output_of(block.code, names, title)
        parts += [page[end : block.start], f"```python\n{block.code}```"]
        if block.output is not None:
            parts.append(f"\n\n```text\n{printed}```")
        elif printed:
            sys.stderr.write(f"{title}: a block prints, and no block of output follows it:\n{block.code}\n{printed}")
        end = block.end
    return "".join([*parts, page[end:]])


def main(paths: list[str]) -> None:
    """Writes the outputs of pages anew."""
    for path in map(Path, paths):
        path.write_text(rewritten(path.read_text(encoding="utf-8"), path.name), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
