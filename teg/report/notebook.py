"""What a notebook shows of an evaluator: its formula, its parameters and its surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from teg.analysis.surfaces import atoms_of
from teg.ir.arrays import Array, Gather, StillGather
from teg.ir.expr import Expr, Param
from teg.ir.index import ArrayName
from teg.ir.latex import latex
from teg.ir.node import postorder
from teg.ir.show import show
from teg.report.explanation import MAX_ROWS, SHOWN, shortened

FORMULA = 2000
"""The largest number of characters of a formula in LaTeX; a longer one is named by its size."""


@dataclass(frozen=True)
class Card:
    """An evaluator in words. `parameters` are (name, kind); `surfaces` are equations, at most `MAX_ROWS` of `count`."""

    title: str
    formula: str
    parameters: tuple[tuple[str, str], ...]
    surfaces: tuple[str, ...]
    count: int

    @property
    def more(self) -> str:
        """Returns a note on surfaces that are not listed."""
        return f"… and {self.count - len(self.surfaces)} more" if self.count > len(self.surfaces) else ""

    def html(self) -> str:
        """Returns the card in HTML; the formula is LaTeX between dollar signs."""
        rows = "".join(f"<tr><td><code>{escape(name)}</code></td><td>{escape(kind)}</td></tr>" for name, kind in self.parameters)
        items = "".join(f"<li><code>{escape(surface)}</code></li>" for surface in self.surfaces)
        parts = [f"<p><b>{escape(self.title)}</b></p><p>$\\displaystyle {escape(self.formula)}$</p>"]
        parts += [f"<table><tr><th>parameter</th><th>kind</th></tr>{rows}</table>"] if rows else []
        parts += [f"<p>Surfaces on which integrands and branches change:</p><ul>{items}</ul>{escape(self.more)}"] if items else []
        return "".join(parts)

    def markdown(self) -> str:
        """Returns the card in Markdown."""
        lines = [f"**{self.title}**", "", f"$$\n{self.formula}\n$$"]
        if self.parameters:
            lines += ["", "| parameter | kind |", "|---|---|", *(f"| `{name}` | {kind} |" for name, kind in self.parameters)]
        if self.surfaces:
            lines += ["", "Surfaces on which integrands and branches change:", "", *(f"- `{surface}`" for surface in self.surfaces)]
            lines += [self.more] if self.more else []
        return "\n".join(lines)


def card_of(e: Expr, leaves: Sequence[Param | ArrayName], wrt: Sequence[Param | ArrayName], backend: str) -> Card:
    """Returns the card of a program; nothing is derived or compiled for it."""
    atoms = list(dict.fromkeys(atom.g for atom in atoms_of(e)))
    moving = set(wrt)
    surfaces = []
    for g in atoms[:MAX_ROWS]:
        moved = any(n in moving or (isinstance(n, Gather) and not isinstance(n, StillGather) and n.array in moving) for n in postorder([g]))
        surfaces.append(f"{shortened(show(g, 4 * SHOWN), SHOWN)} = 0" + ("" if moved else " (does not move)"))
    kinds = tuple((p.name, _kind(p) + (", differentiated by" if p in moving else "")) for p in leaves)
    return Card(f"teg.Evaluator on {backend}", latex(e, FORMULA), kinds, tuple(surfaces), len(atoms))


def _kind(p: Param | ArrayName) -> str:
    if isinstance(p, Param):
        return "number"
    return f"array of {p.dimensions} {'dimension' if p.dimensions == 1 else 'dimensions'}" + ("" if isinstance(p, Array) else ", integers")
