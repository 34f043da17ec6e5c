"""Moments of hyperbolas as statements: value, boundary terms and what decides ties, of all integrals that share a surface and a box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from teg.analysis.settings import Integration
from teg.ir.expr import Expr
from teg.ir.integral import Border, Integral
from teg.ir.node import Node
from teg.passes.intrinsics.hyperbola.match import Coefficients, Corners, Sides, match_hyperbola
from teg.passes.intrinsics.polygon.emit import ClippedEmitter
from teg.passes.lower.emit import Level
from teg.program import Arg, Hyperbola, Moments


@dataclass
class _Together:
    """What is asked of one surface over one box."""

    regions: list[tuple[Integral, Sides]] = field(default_factory=list)
    borders: list[Border] = field(default_factory=list)


class CurvedEmitter(ClippedEmitter):
    """An emitter that also knows the moments of hyperbolas."""

    def __init__(self, parameters: Sequence[str], how: Integration) -> None:
        super().__init__(parameters, how)
        self._together: dict[Corners, _Together] = {}
        self._of: dict[Node, Corners] = {}

    def plan_moments(self, level: Level, order: Sequence[Node]) -> set[Node]:
        """Find what has moments in closed form, among nodes of which the outermost level is made; the integrals among them."""
        if level.var is not None or level.coordinates is not None:
            return set()
        for node in order:
            if isinstance(node, Border):
                corners = node.corners
                self._together.setdefault(corners, _Together()).borders.append(node)
            elif isinstance(node, Integral) and not node.free and (found := match_hyperbola(node, self.how)) is not None:
                corners = found.corners
                self._together.setdefault(corners, _Together()).regions.append((node, found))
            else:
                continue
            self._of[node] = corners
        return {n for n in self._of if isinstance(n, Integral)}

    def has_moments(self, node: Integral) -> bool:
        """Whether an integral is known in closed form."""
        return node in self._of

    def integrate(self, node: Integral, home: Level) -> None:
        """Give an integral whose value is a moment a name."""
        self._emit_moments(self._of[node], home)

    def value(self, e: Expr, home: Level) -> Arg:
        """A border is a moment."""
        if not isinstance(e, Border):
            return super().value(e, home)
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
                    names.append(self.fresh("v"))
                    parts.setdefault(node, []).append(names[-1])
        for border in together.borders:
            if border.coefficients:
                moments.append(self._moments("border", border.coefficients, home))
                names.append(self.fresh("v"))
                parts[border] = [names[-1]]
        values = tuple(self.number(e, home) for e in corners)
        ties: tuple[int, ...] = ()
        scales: tuple[Arg, ...] = ()
        if together.borders:  # a region does not change where its border does
            scales = tuple(self.tie_scale(e, home) for e in corners)
            ties = tuple(self.ties.setdefault(pair, len(self.ties)) for pair in together.borders[0].rivals)
        home.block.append(Hyperbola(values, (), scales, ties, tuple(moments), tuple(names)))
        for node, sides in together.regions:
            mine = parts.get(node, [])
            total: Arg = 0.0 if not mine else mine[0] if len(mine) == 1 else self.assign(home, "v", "add", *mine)
            area = self.number(sides.area, home)
            home.names[node] = total if area == 1.0 or not mine else self.assign(home, "v", "mul", total, area)
        for border in together.borders:
            home.names[border] = parts[border][0] if border in parts else 0.0

    def _moments(self, kind: str, coefficients: Coefficients, home: Level) -> Moments:
        return Moments(kind, tuple((j, k, self.number(c, home)) for (j, k), c in coefficients.items()))
