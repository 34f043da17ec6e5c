"""The interface of an intrinsic, a fast path of one shape of program. `teg.passes.intrinsics` lists all of them.

An intrinsic computes whole integrals by statements of its own (`Lowering`), or integrates between breaks by a rule of its own
(`ExactRule`). It may also have closed forms for boundary terms. Without it, integrals are computed by pieces and the general rules, and
boundary terms by the charts of their family.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from teg.analysis.breaks import BreakAnalysis
from teg.ir.integral import ClosedForm, Integral
from teg.ir.node import Node
from teg.passes.eliminate.families import Closed
from teg.passes.lower.emit import Emitter
from teg.passes.lower.levels import Level
from teg.program import Arg, Rule, Stmt
from teg.program.arrays import ArrayProgram


class Lowering:
    """The computation of the integrals of one program by one intrinsic. Each intrinsic defines the methods it needs;
    these compute nothing."""

    name: str
    """The name of the intrinsic in remarks."""

    def claim(self, level: Level, order: Sequence[Node]) -> Iterable[Integral]:
        """Returns those integrals among the nodes of a level that are computed alone, without a guard (`emit_claimed`).

        `order` has the nodes of the level, children first.
        """
        return ()

    def emit_claimed(self, node: Integral, home: Level) -> None:
        """Gives an integral that was claimed a name in `home.names`."""
        raise AssertionError(f"{node} was not claimed")

    def key(self, node: Integral, level: Level) -> object | None:
        """Returns a key that is equal for integrals which one statement can compute together; None for other integrals."""
        return None

    def emit(self, group: Sequence[Integral], home: Level, when: str | None) -> Sequence[Arg]:
        """Returns the results of integrals with the same key; `when` names the boolean without which they are not needed."""
        raise AssertionError(f"{group[0]} has no key")

    def closed_form(self, e: ClosedForm, home: Level) -> Arg | None:
        """Returns the name of a number in closed form; None for one of another intrinsic."""
        return None


class ExactRule(Protocol):
    """A rule that is exact for one shape of integrand."""

    @property
    def rule(self) -> type[Rule]:
        """The class of its rules."""

    @property
    def title(self) -> str:
        """The name in reports."""

    @property
    def bend(self) -> str:
        """The kind of bend that is an operand of the rule, whether it is known to count or not."""

    def match(self, node: Integral, analysis: BreakAnalysis) -> Rule | None:
        """Returns the rule for an integral between finite bounds, or None."""

    def key(self, node: Integral, analysis: BreakAnalysis) -> object:
        """Returns a key that is equal for integrals of the rule that can share a loop."""

    def shared(self, rules: Sequence[Rule]) -> Rule:
        """Returns one rule for all integrals of a loop."""


ROUNDINGS = 16 * 2.0**-52
"""A few roundings of a number, relative to it."""
LEAST = 1e-300
"""Replaces a divisor that is 0."""


class Errors(Protocol):
    """The operations that an error rule may use, of the pass that carries errors through a program (`teg.passes.program.errors`).

    An error is a name or a literal, 0.0 for a number that is exact. Statements are appended to `out`.
    """

    errors: dict[Arg, Arg]

    def fresh(self, kind: str) -> str:
        """Returns an unused name."""

    def error(self, arg: Arg) -> Arg:
        """Returns the error of a number."""

    def uncertainty(self, arg: Arg, out: list[Stmt]) -> Arg:
        """Returns the error of a number and of its roundings."""

    def block(self, block: Sequence[Stmt]) -> tuple[Stmt, ...]:
        """Returns a block with the errors of its values."""

    def op(self, out: list[Stmt], op: str, *args: Arg) -> Arg:
        """Returns the name of op(args)."""

    def sum_of(self, parts: Iterable[Arg], out: list[Stmt]) -> Arg:
        """Returns the sum of errors."""

    def times(self, out: list[Stmt], size: Arg, error: Arg) -> Arg:
        """Returns |size|·error."""


ErrorRule = Callable[[Errors, Any, list[Stmt]], None]
"""Appends a statement with the values its errors need, and sets the errors of its results."""


CLOSED_FORM = "closed form"
"""The last words in the name of a rule without nodes."""


@dataclass(frozen=True)
class Description:
    """An integral that an intrinsic computes, for reports.

    The name of the rule, its nodes a piece and pieces, and the degree of the integrand, if there are any; and the inner integrals
    computed with it.
    """

    rule: str
    nodes: int | None
    degree: int | None
    pieces: int
    inside: tuple[Integral, ...]


@dataclass(frozen=True)
class Statement:
    """The data of an intrinsic's statement for passes and reports: its error rule, the numbers whose roundings count in it, the number of
    evaluations of its integrand in a run, and the least number of them that its rule can do with."""

    errors: ErrorRule
    numbers: Callable[[Any], tuple[Arg, ...]]
    evaluations: Callable[[Any], int]
    least: Callable[[Any], int]


@dataclass(frozen=True)
class Intrinsic:
    """A fast path of one shape of program."""

    name: str
    lowering: Callable[[Emitter], Lowering] | None = None
    rule: ExactRule | None = None
    boundary: Closed | None = None
    describe: Callable[[Integral], Description | None] = lambda node: None
    loops: Callable[[ArrayProgram], ArrayProgram] | None = None
    """A pass over programs with loops around its statements."""
    statements: Mapping[type, Statement] = field(default_factory=dict)
