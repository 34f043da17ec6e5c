"""Moments of ellipses as statements: values and boundary terms of all integrals that share an ellipse and a box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from teg.analysis.boxes import Coefficients
from teg.ir.integral import ClosedForm, Integral
from teg.ir.node import Node
from teg.passes.intrinsics.ellipse.match import Arcs, Curve, Cut, Powers, Sides, match_ellipse
from teg.passes.lower.emit import Emitter
from teg.passes.lower.intrinsic import Lowering
from teg.passes.lower.levels import Level
from teg.program import Arg, Ellipse, HalfPlane, Moments


@dataclass
class _Together:
    """The moments needed of one ellipse on one box at one level, which is held so that no other one has its identity."""

    level: Level
    regions: dict[Integral, Sides] = field(default_factory=dict)
    arcs: dict[Arcs, None] = field(default_factory=dict)


class EllipseLowering(Lowering):
    """Moments of the ellipses of one program. Statements go to `out`."""

    name = "ellipse"

    def __init__(self, out: Emitter) -> None:
        self.out = out
        self._together: dict[tuple[int, Curve], _Together] = {}  # by the identity of the level
        self._sides: dict[Integral, Sides] = {}

    def claim(self, level: Level, order: Sequence[Node]) -> list[Integral]:
        """Returns the integrals of a level that are moments of an ellipse; records these and the arcs."""
        if level.coordinates is not None:
            return []
        inner = {node.var for node in order if isinstance(node, Integral)}
        claimed: list[Integral] = []
        for node in order:
            if not isinstance(node, Arcs | Integral):
                continue
            if node.free if level.var is None else level.var not in node.free or node.free & inner:
                continue
            if isinstance(node, Arcs):
                self._shared(level, node.curve).arcs[node] = None
            elif (sides := match_ellipse(node)) is not None:
                self._sides[node] = sides
                self._shared(level, sides.curve).regions[node] = sides
                claimed.append(node)
        return claimed

    def _shared(self, level: Level, curve: Curve) -> _Together:
        return self._together.setdefault((id(level), curve), _Together(level))

    def emit_claimed(self, node: Integral, home: Level) -> None:
        """Gives an integral a name, and all that share its ellipse and box."""
        sides = self._sides[node]
        self._shared(home, sides.curve).regions[node] = sides
        self._emit(sides.curve, home)

    def closed_form(self, e: ClosedForm, home: Level) -> Arg | None:
        """Returns the name of a moment along arcs."""
        if not isinstance(e, Arcs):
            return None
        if e not in home.names:
            self._shared(home, e.curve).arcs[e] = None
            self._emit(e.curve, home)
        return cast(Arg, home.names[e])

    def _emit(self, curve: Curve, home: Level) -> None:
        together = self._shared(home, curve)
        moments: list[Moments] = []
        names: list[str] = []
        parts: dict[Node, list[str]] = {}
        wanted: list[tuple[Node, str, Coefficients, Powers]] = []
        for node, sides in together.regions.items():
            wanted += [(node, "above", sides.inside, (0, 0)), (node, "below", sides.outside, (0, 0))]
        for arcs in together.arcs:
            wanted += [(arcs, "border", coefficients, axes) for axes, coefficients in (arcs.coefficients or {(0, 0): {}}).items()]
        wanted = [each for each in wanted if each[0] not in home.names]
        for shared, kind, coefficients, axes in wanted:
            if coefficients:
                moments.append(Moments(kind, tuple((j, k, self.out.number(c, home)) for (j, k), c in coefficients.items()), axes))
                names.append(self.out.fresh("v"))
                parts.setdefault(shared, []).append(names[-1])
        if names:
            matrix, place = (tuple(self.out.number(e, home) for e in part) for part in (curve.matrix, curve.place))
            planes = tuple(self._half_plane(cut, home) for cut in curve.cuts)
            home.block.append(Ellipse(matrix, place, tuple(moments), tuple(names), None, planes))
        for known in dict.fromkeys(node for node, *_ in wanted):
            mine = parts.get(known, [])
            home.names[known] = 0.0 if not mine else mine[0] if len(mine) == 1 else self.out.assign(home, "add", *mine)

    def _half_plane(self, cut: Cut, home: Level) -> HalfPlane:
        a, b, c = (self.out.number(e, home) for e in cut.line)
        return HalfPlane(a, b, c, cut.closed)
