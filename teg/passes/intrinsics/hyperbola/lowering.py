"""Moments of hyperbolas as statements: values, boundary terms and scales of ties, of all integrals that share a surface and a box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from teg.analysis.boxes import Coefficients
from teg.analysis.expanded import expanded
from teg.ir.expr import Add, Const, Expr, Mul, Param
from teg.ir.integral import ClosedForm, Integral
from teg.ir.node import Node
from teg.ir.simplify import mul, sub
from teg.passes.intrinsics.hyperbola.match import Border, Corners, Sides, match_hyperbola
from teg.passes.lower.emit import Emitter
from teg.passes.lower.intrinsic import Lowering
from teg.passes.lower.levels import Level
from teg.program import Arg, Hyperbola, Moments


@dataclass
class _Together:
    """The moments needed of one surface over one box."""

    regions: list[tuple[Integral, Sides]] = field(default_factory=list)
    borders: list[Border] = field(default_factory=list)


class HyperbolaLowering(Lowering):
    """Moments of the hyperbolas of one program. Statements go to `out`."""

    name = "hyperbola"

    def __init__(self, out: Emitter) -> None:
        self.out = out
        self._together: dict[Corners, _Together] = {}
        self._of: dict[Node, Corners] = {}

    def claim(self, level: Level, order: Sequence[Node]) -> list[Integral]:
        """Returns the integrals of the outermost level that are moments in closed form; records these and the borders."""
        if level.var is not None or level.coordinates is not None:
            return []
        claimed: list[Integral] = []
        for node in order:
            if isinstance(node, Border):
                self._of[node] = node.corners
                self._together.setdefault(node.corners, _Together()).borders.append(node)
            elif isinstance(node, Integral) and not node.free and (sides := match_hyperbola(node)) is not None:
                self._of[node] = sides.corners
                self._together.setdefault(sides.corners, _Together()).regions.append((node, sides))
                claimed.append(node)
        return claimed

    def emit_claimed(self, node: Integral, home: Level) -> None:
        """Gives an integral a name, and all that share its surface and box."""
        self._emit_moments(self._of[node], home)

    def closed_form(self, e: ClosedForm, home: Level) -> Arg | None:
        """Returns the name of a border's moment."""
        if not isinstance(e, Border):
            return None
        if e not in home.names:
            self._emit_moments(self._of[e], home)
        return cast(Arg, home.names[e])

    def _emit_moments(self, corners: Corners, home: Level) -> None:
        together = self._together[corners]
        moments: list[Moments] = []
        names: list[str] = []
        parts: dict[Node, list[str]] = {}
        for node, sides in together.regions:
            for kind, coefficients in (("above", sides.above), ("below", sides.below)):
                if coefficients:
                    moments.append(self._moments(kind, coefficients, home))
                    names.append(self.out.fresh("v"))
                    parts.setdefault(node, []).append(names[-1])
        for border in together.borders:
            if border.coefficients:
                moments.append(self._moments("border", border.coefficients, home))
                names.append(self.out.fresh("v"))
                parts[border] = [names[-1]]
        values = tuple(self.out.number(e, home) for e in corners)
        ties: tuple[int, ...] = ()
        scales: tuple[Arg, ...] = ()
        if together.borders:  # a region does not change where its border does
            scales = tuple(self.out.rounding.tie_scale(e, home) for e in corners)
            ties = tuple(self.out.number_of_tie(pair) for pair in together.borders[0].rivals)
        exact = expanded(sub(mul(corners[0], corners[2]), mul(corners[1], corners[3])), 2)
        turn = self.out.number(exact, home) if exact is not None and _keeps_digits(exact) else math.nan
        home.block.append(Hyperbola(values, (), scales, ties, tuple(moments), tuple(names), turn=turn))
        for node, sides in together.regions:
            mine = parts.get(node, [])
            total: Arg = 0.0 if not mine else mine[0] if len(mine) == 1 else self.out.assign(home, "add", *mine)
            area = self.out.number(sides.area, home)
            home.names[node] = total if area == 1.0 or not mine else self.out.assign(home, "mul", total, area)
        for border in together.borders:
            home.names[border] = parts[border][0] if border in parts else 0.0

    def _moments(self, kind: str, coefficients: Coefficients, home: Level) -> Moments:
        return Moments(kind, tuple((j, k, self.out.number(c, home)) for (j, k), c in coefficients.items()))


def _keeps_digits(e: Expr) -> bool:
    """Returns whether an expanded sum is rounded relative to itself: one monomial, or two numbers or parameters times powers of 2."""
    if not isinstance(e, Add):
        return True
    return all(isinstance(t, Param | Const) or (isinstance(t, Mul) and _is_scaled_by_a_power_of_two(t)) for t in e.children)


def _is_scaled_by_a_power_of_two(e: Mul) -> bool:
    factor, *others = e.children
    return isinstance(factor, Const) and abs(math.frexp(factor.data)[0]) == 0.5 and len(others) == 1 and isinstance(others[0], Param)
