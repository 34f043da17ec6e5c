"""The derivation of a program, with the bodies of its functions, or with candidates written out where derivatives need that.

Plans with the same task share a derivation, and with it the work of all passes: those of one program for two backends, for instance.
A program with functions is derived with slots in their places (`teg.function`), so that programs share one that differ only in the bodies
of their functions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.settings import Integration
from teg.errors import NotDifferentiableError
from teg.evaluator.derivation import Task, derivation_of, has_loops
from teg.evaluator.kept import Kept
from teg.evaluator.options import Options
from teg.evaluator.wanted import Wanted
from teg.ir.expr import Expr, Param
from teg.ir.index import ArrayName
from teg.ir.node import nodes_of
from teg.ir.partition import Partition
from teg.passes.differentiate.through_sums import Parameter
from teg.passes.normalise.choices import raise_unwritten, without_uncovered
from teg.passes.normalise.inline import with_slots, without_slots, write_out
from teg.passes.normalise.integers import with_sums_of_integers
from teg.passes.normalise.partitions import Refused
from teg.passes.program.link import with_bodies
from teg.pipeline import flatten
from teg.program import Program
from teg.program.arrays import ArrayProgram


class Plan:
    """A derivation, and the functions that stand in its slots.

    `source` is the expression that is differentiated in the place of a program with arrays. `entries` are the values, `leaves` the
    parameters and arrays; derivatives are taken by the leaves in `wrt`; `integers` are the parameters that stand behind all others.
    """

    def __init__(
        self,
        e: Expr,
        options: Options,
        wrt: Sequence[Parameter],
        leaves: Sequence[Param | ArrayName],
        integers: Sequence[Param] = (),
        source: Expr | None = None,
    ) -> None:
        self.expression, self.options = e, options
        self.wrt, self.leaves, self.integers = tuple(wrt), tuple(leaves), tuple(integers)
        in_loops = has_loops(e, self.leaves, self.integers)
        abstract, self.functions = (with_sums_of_integers(e), ()) if in_loops else with_slots(write_out(e))
        how = options.integration, options.estimator, tuple(options.maps)
        source = None if source is None else with_sums_of_integers(source)
        self.derivation = derivation_of(Task(abstract, self.wrt, self.leaves, self.integers, *how, source))
        self.entries, self.has_loops = flatten(e), self.derivation.has_loops
        self._touching = [n for n in nodes_of(Partition, e) if n.layout.touching]
        self._written: Kept[None, Plan] = Kept(1)
        self._refused: Kept[Wanted, str] = Kept()
        self._linked: Kept[tuple[Wanted, int | None, bool, Integration | None], Program] = Kept()

    @property
    def follows_edges(self) -> bool:
        """Returns whether candidates are followed along their edges."""
        return self.derivation.task.follows_edges

    @property
    def may_need_lengths(self) -> bool:
        """Returns whether candidates may have to be written out for second derivatives."""
        return self.follows_edges or bool(self._touching)

    def needs_lengths(self, wanted: Wanted) -> bool:
        """Returns whether candidates must be written out for these outputs, although values and gradients follow their edges."""
        return bool(self._why_written_out(wanted))

    def _why_written_out(self, wanted: Wanted) -> str:
        """Returns the reason why candidates must be written out for these outputs; nothing if they need not be."""
        if wanted.along and self._touching:
            return "it has alternatives that share corners, and is differentiated twice"
        if not (wanted.along and self.follows_edges):
            return ""

        def reason() -> str:
            try:
                self.derivation.program(wanted)
            except Refused as refused:
                return refused.reason
            except NotDifferentiableError as error:
                return error.what
            return ""

        return self._refused.get(wanted, reason)

    def _written_out(self, reason: str) -> Plan:
        """Returns the plan of the same program with candidates written out. Raises NeedsLengths."""
        for node in self._touching:
            raise_unwritten(node, reason)

        def made() -> Plan:
            e = without_uncovered(self.expression, reason)
            return Plan(e, self.options, self.wrt, self.leaves, self.integers)

        return self._written.get(None, made)

    def outputs(self, wanted: Wanted) -> list[Expr]:
        """Returns the outputs of a program without loops, without δ, with its functions."""
        found = self.derivation.outputs(wanted)
        return [without_slots(e, self.functions) for e in found] if self.functions else found

    def program(
        self, wanted: Wanted, entry: int | None = None, errors: bool = False, how: Integration | None = None
    ) -> Program | ArrayProgram:
        """Returns the program of all values or of one entry, as `Derivation.program` does, with the bodies of the functions."""
        if reason := self._why_written_out(wanted):
            return self._written_out(reason).program(wanted, entry, errors, how)
        if not self.functions:
            return self.derivation.program(wanted, entry, errors, how)

        def linked() -> Program:
            return with_bodies(cast(Program, self.derivation.program(wanted, entry, errors, how)), self.functions)

        return self._linked.get((wanted, entry, errors, how), linked)
