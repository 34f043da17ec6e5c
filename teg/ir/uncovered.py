"""Integrals over what no candidate covers, of which there are as many as the data say.

    e ::= … | uncovered[j: i..i, x, …](b, e; e, e, …)      ∫…∫ e over the part of a box where no j has b; then the bounds of each variable
    e ::= … | gaps[j: i..i, s](e, e, b, b, b; e)           Σ of the numbers behind the semicolon over the gaps between covered intervals

Users do not write them: `teg.passes.normalise.choices` makes the first of integrals of `teg.any`, `teg.passes.differentiate.edges` the
second of the first.
"""

from __future__ import annotations

from typing import Any, cast

from teg.ir.arrays import Ranged
from teg.ir.expr import Cond, Expr, Param, Var, Where
from teg.ir.function import Apply, Slot
from teg.ir.index import APART
from teg.ir.node import Node, nodes_of, union

TURN = Param.make(f"{APART}turn cos", ()), Param.make(f"{APART}turn sin", ())
"""The cosine and the sine of the angle around which a quarter of an ellipse lies, in integrals along it: there is one for each quarter."""
HALF = Param.make(f"{APART}half", ())
"""0 on that half of a circle that is near, 1 on the other one."""
ARC = Param.make(f"{APART}arc", ())
"""Which arc of a conic is followed, from 0 to 11: six of the one branch, then those of the other one."""
ARCS = 12
SHIFT = Param.make(f"{APART}shift", ())
"""How far an edge is moved along the inner variable: derivatives by it are taken once, where it is 0."""
VELOCITIES = Param.make(f"{APART}left moves", ()), Param.make(f"{APART}right moves", ())
"""The velocities of the ends of a gap."""


def marks_of(root: Node) -> list[Apply]:
    """Returns the places in an expression that candidates may cover: functions without a body."""
    return [n for n in nodes_of(Apply, root) if isinstance(n.callee, Slot) and len(n.callee.data) > 4]


class Uncovered(Ranged, Expr):
    """∫…∫ body over the part of a box that no candidate covers; data are (index, lo, hi, variables), the outermost variable first, and
    True if conditions that the user wrote do not move with parameters.

    Children: the condition under which a candidate covers a point, one outside of which candidates cover every point, the body, and a
    lower and an upper bound for each variable.
    """

    __slots__ = ()

    def _free_variables(self) -> frozenset[Any]:
        return union([c.free for c in self.children]) - set(self.variables)

    @property
    def variables(self) -> tuple[Var, ...]:
        return cast("tuple[Var, ...]", self.data[3])

    @property
    def has_still_conditions(self) -> bool:
        """Returns whether conditions that the user wrote do not move."""
        return len(self.data) > 4

    @property
    def condition(self) -> Cond:
        return cast(Cond, self.children[0])

    @property
    def within(self) -> Cond:
        return cast(Cond, self.children[1])

    @property
    def body(self) -> Expr:
        return cast(Expr, self.children[2])

    @property
    def bounds(self) -> tuple[tuple[Expr, Expr], ...]:
        """Returns the lower and the upper bound of each variable."""
        ends = cast("tuple[Expr, ...]", self.children[3:])
        return tuple(zip(ends[::2], ends[1::2], strict=True))


class Gaps(Ranged, Expr):
    """Σ term over the gaps that candidates leave between `first` and `last`; data are (index, lo, hi, variable, left, right).

    Children: first, last, whether a candidate covers the place of the variable, as 1 or 0, the same where it ties (there the border of a
    candidate runs along the line of the variable), whether the place matters, and the term, in which the parameters `left` and `right` are
    the ends of a gap. Where no place matters the term is 0 on every gap, or all is covered.

    In a derivative the term may depend on how fast ends move, which the parameters `VELOCITIES` stand for. Then there are more children:
    the velocities of first and last, and that of each border of a candidate, as a `Where` whose condition has this border.
    """

    __slots__ = ()

    def _free_variables(self) -> frozenset[Any]:
        return union([c.free for c in self.children]) - {self.variable}

    @property
    def variable(self) -> Var:
        return cast(Var, self.data[3])

    @property
    def ends(self) -> tuple[Param, Param]:
        """Returns the parameters that stand for the ends of a gap."""
        return cast(Param, self.data[4]), cast(Param, self.data[5])

    @property
    def covered(self) -> Expr:
        return cast(Expr, self.children[2])

    @property
    def tie(self) -> Expr:
        return cast(Expr, self.children[3])

    @property
    def matters(self) -> Expr:
        return cast(Expr, self.children[4])

    @property
    def term(self) -> Expr:
        return cast(Expr, self.children[5])

    @property
    def is_moving(self) -> bool:
        """Returns whether the term may depend on the velocities of ends."""
        return len(self.children) > 6

    @property
    def outer_velocities(self) -> tuple[Expr, ...]:
        """Returns the velocities of `first` and `last`, if the term depends on those of ends."""
        return cast("tuple[Expr, ...]", self.children[6:8])

    @property
    def velocities(self) -> tuple[Where, ...]:
        """Returns the velocity along the line of each border of a candidate, behind a condition that has this border."""
        return cast("tuple[Where, ...]", self.children[8:])

    @property
    def line(self) -> tuple[object, ...]:
        """Returns what sums over the same gaps have in common, whether these move or not."""
        return (*self.data, *self.children[:4])
