"""The expressions of a program's values and derivatives without δ, and the programs that compute them.

Each is the symbolic derivative: e is differentiated forward along each direction, whose components are parameters of their own, and then
in reverse. A program without loops is one cell, and its derivation has one flat program. Otherwise every cell goes through the same passes,
the chain rule goes through sums, and the result is a program of loops around flat programs.

A derivation lives as long as a plan that uses it: the table of derivations holds weak references only.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, cast

from teg.analysis.settings import Integration
from teg.errors import EstimatorError
from teg.evaluator.kept import Kept
from teg.evaluator.timing import log, timed
from teg.evaluator.wanted import VALUE, Wanted, directions_of, is_second
from teg.ir import simplify
from teg.ir.arrays import Array, has_arrays
from teg.ir.cells import replaced
from teg.ir.expr import ZERO, Expr, Param, Var
from teg.ir.index import ArrayName
from teg.ir.node import Node, nodes_of, postorder
from teg.ir.partition import Partition
from teg.ir.still import has_still, released
from teg.ir.traverse import size
from teg.ir.uncovered import Uncovered
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.differentiate.edges import values_along_edges
from teg.passes.differentiate.estimators.estimator import Estimator
from teg.passes.differentiate.estimators.ignore import Ignore, ignore_discontinuities
from teg.passes.differentiate.parted import with_alternatives_apart
from teg.passes.differentiate.through_sums import Parameter, gradient, on_cells, rates_along_edges, tangent
from teg.passes.intrinsics import with_loops
from teg.passes.lower.gaps import Candidate, schedule_matters, schedule_places
from teg.passes.lower.integrals import About
from teg.passes.lower.loops import Output, output_of, schedule_arrays
from teg.passes.lower.weights import has_relative_sums
from teg.passes.normalise.canonicalise import canonicalise
from teg.passes.normalise.choices import without_uncovered
from teg.passes.normalise.partitions import Refused
from teg.passes.normalise.tables import with_tables
from teg.passes.program.errors_in_loops import with_array_error_estimates
from teg.pipeline import (
    ESTIMATORS,
    PLAIN,
    Begun,
    Elimination,
    begun,
    compiled_outputs,
    finished,
    flat_program,
    flatten,
    jvp,
    normal_form,
    program_for,
)
from teg.program import Program
from teg.program.arrays import ArrayProgram

SHORT = 10_000
"""Nodes of a program of which the beginning of its derivations is kept, at most."""


@dataclass(frozen=True)
class Task:
    """The input of a derivation: the expression, the parameters of its derivatives, the arguments of the program, and the options.

    `source` is the expression that is differentiated in the place of one with arrays; None if the estimator does not take it. `edges`
    has what integrals over what candidates do not cover are along the edges of these. Arguments are `leaves`, then the directions, and the
    integers among the numbers at the end.
    """

    expression: Expr
    wrt: tuple[Parameter, ...]
    leaves: tuple[Param | ArrayName, ...]
    integers: tuple[Param, ...]
    integration: Integration
    estimator: Estimator
    maps: tuple[Diffeomorphism, ...]
    source: Expr | None = None
    edges: tuple[tuple[Node, Expr], ...] = ()

    @property
    def follows_edges(self) -> bool:
        """Returns whether candidates are followed along their edges, for values and first derivatives."""
        return bool(self.edges)

    def computed(self, e: Expr) -> Expr:
        """Returns an expression in which integrals over what candidates do not cover are computed along their edges, whether or not it
        still holds parameters of these still."""
        known = {form: along for n, along in self.edges for form in (n, released(cast(Expr, n)))}
        return replaced([e], known)[0] if known else e

    @property
    def elimination(self) -> Elimination:
        """Returns how δ are eliminated."""
        return Elimination(self.maps, self.integration.closed_forms)


class Derivation:
    """Outputs and programs of one task, by the wanted derivatives. `slopes` has gradients that are known already, by the value."""

    def __init__(self, task: Task, slopes: Mapping[Expr, list[Expr]] | None = None) -> None:
        self.task = task
        self.entries = flatten(task.expression)
        self.first_only = not task.estimator.has_all_orders
        self.has_loops = has_loops(task.expression, task.leaves, task.integers)
        self._begun: Kept[Expr, Begun] = Kept(1)
        self._outputs: Kept[tuple[Wanted, int | None], list[Expr]] = Kept()
        self._programs: Kept[tuple[Wanted, int | None, bool, Integration], Program | ArrayProgram] = Kept()
        self._slopes: Kept[tuple[Expr, bool], list[Expr]] = Kept()
        self._places: Kept[tuple[tuple[Expr, ...], tuple[str, ...], Var, Integration], Program] = Kept()
        if slopes and task.estimator.name == "exact" and task.elimination == PLAIN:
            for value, known in slopes.items():
                self._slopes.put((value, False), known)

    def outputs(self, wanted: Wanted, entry: int | None = None) -> list[Expr]:
        """Returns the outputs of a program without loops, without δ: value, gradient, Hessian (up to the given order)."""
        return self._outputs.get((wanted, entry), lambda: self._flat_outputs(wanted, entry))

    def program(
        self, wanted: Wanted, entry: int | None = None, errors: bool = False, how: Integration | None = None
    ) -> Program | ArrayProgram:
        """Returns the program of all values or of one entry; with `errors`, estimates of the errors of the outputs follow them.

        It is integrated by the task's options, or by `how`.
        """
        how = how or self.task.integration
        if self.first_only and (wanted.along or (self.has_loops and wanted.orders and self.task.source is None)):
            raise EstimatorError(f"discontinuities={self.task.estimator.name!r} {self._limit(wanted)}", None, self._way_out())
        make = self._looped if self.has_loops else self._flat

        def derived() -> Program | ArrayProgram:
            with timed(wanted.title + (" with error estimates" if errors else ""), "derived"):
                return make(wanted, entry, errors, how)

        return self._programs.get((wanted, entry, errors, how), derived)

    @staticmethod
    def _limit(wanted: Wanted) -> str:
        return "gives no second derivatives" if wanted.along else "takes no choices among data (teg.nearest, teg.any) inside of integrals"

    def _way_out(self) -> str:
        soft = self.task.estimator.name == "smooth" and self.has_loops
        return '"exact" and "ignore" do' + (', and "smooth" does for teg.nearest with estimator={"gamma": …}' if soft else "")

    def directions(self, wanted: Wanted) -> list[dict[Parameter, Parameter]]:
        """Returns the components of each direction: ∂t of t."""
        return directions_of(wanted, [*self.task.leaves, *self.task.integers])

    def arguments(self, wanted: Wanted) -> list[Param | ArrayName]:
        """Returns the parameters of a program in order; arrays are counted by themselves."""
        return [*self.task.leaves, *(q for d in self.directions(wanted) for q in d.values()), *self.task.integers]

    # -- without loops -------------------------------------------------------------------------------------------------

    def _flat_outputs(self, wanted: Wanted, entry: int | None) -> list[Expr]:
        task = self.task
        source, wrt = task.expression if entry is None else self.entries[entry], cast("tuple[Param, ...]", task.wrt)
        beginning = None if wanted.along or (self.first_only and wanted.orders) else self._beginning(source)
        for direction in self.directions(wanted):
            source = self._without_deltas(jvp(source, cast("dict[Param | Var, object]", direction), task.maps))
        outputs = compiled_outputs(source, wrt, wanted.orders, task.estimator, task.elimination, beginning)
        return outputs if wanted.values else outputs[1:]

    def _beginning(self, source: Expr) -> Begun:
        """Returns the beginning that values and derivatives share. It is kept, unless the program is long."""
        beginning = self._begun.get(source, lambda: begun(source, self.task.elimination))
        if size(beginning.normal) > SHORT:
            self._begun.drop(source)
        return beginning

    def _flat(self, wanted: Wanted, entry: int | None, errors: bool, how: Integration) -> Program:
        names = [p.name for p in self.arguments(wanted)]
        values = self.outputs(VALUE, entry)
        outputs = [leaf for e in self.outputs(wanted, entry) for leaf in flatten(e)]
        program = program_for(outputs, names, how, errors, about=About(differentiated=flatten(values[0])))
        return replace(program, weighs_ties=is_second(wanted))

    # -- with loops ----------------------------------------------------------------------------------------------------

    def _looped(self, wanted: Wanted, entry: int | None, errors: bool, how: Integration) -> ArrayProgram:
        outputs = self._looped_outputs(wanted, entry, not errors)
        values = outputs[: len(self.entries) if entry is None else 1] if wanted.values else self._looped_outputs(VALUE, entry, not errors)
        program = self.scheduled(
            outputs, wanted, how, unfinished=errors, differentiated=[v if isinstance(v, Expr) else v[1] for v in values]
        )
        return with_array_error_estimates(program) if errors else with_loops(program)

    def scheduled(
        self, outputs: Sequence[Output], wanted: Wanted, how: Integration, unfinished: bool = False, differentiated: Sequence[Expr] = ()
    ) -> ArrayProgram:
        """Returns the program of some outputs, with the arguments of `wanted`, which may be derivatives of the `differentiated`
        expressions. An unfinished program lacks the last passes over flat programs."""
        arguments = self.arguments(wanted)
        outputs = [(output[0], released(output[1])) if isinstance(output, tuple) else released(output) for output in outputs]

        is_relative = has_relative_sums([output[1] if isinstance(output, tuple) else output for output in outputs])

        def flat(cells: Sequence[Expr], names: Sequence[str], sources: Sequence[Expr]) -> Program:
            # one surface is one expression, so that outputs share loops
            together, known = (flatten(canonicalise(simplify.tuple_of(*several))) for several in (cells, sources))
            about = About(differentiated=known, relative=is_relative)
            program = (flat_program if unfinished else program_for)(together, names, how, about=about)
            return replace(program, weighs_ties=is_second(wanted))

        def places(cells: Sequence[Expr], names: Sequence[str], line: Var) -> Program:
            def made() -> Program:
                numbers = [released(canonicalise(c)) for c in cells]
                if len(numbers) == 1:
                    return schedule_matters(numbers[0], line, names, how)
                return schedule_places(Candidate(numbers[0], numbers[1], tuple(numbers[2:])), line, names, how)

            program = self._places.get((tuple(cells), tuple(names), line, how), made)  # values and derivatives have most of them in common
            return program if unfinished else finished(program)

        scalars = [p.name for p in arguments if isinstance(p, Param)]
        listed = [p for p in arguments if isinstance(p, ArrayName)]
        return schedule_arrays(outputs, scalars, listed, (flat, places), differentiated)

    def _looped_outputs(self, wanted: Wanted, entry: int | None, tables: bool) -> list[Output]:
        """Returns the computed numbers and arrays, without δ. With `tables`, numbers of candidates are read from these."""
        task, entries = self.task, self.entries if entry is None else [self.entries[entry]]
        if task.follows_edges and wanted.along:
            return self._second_along_edges(entries, wanted)
        moved = entries if task.source is None else [e for i, e in enumerate(flatten(task.source)) if entry in (None, i)]
        if tables:
            entries, moved = ([with_tables(e) for e in several] for several in (entries, moved))
        normal = partial(normal_form, maps=task.maps)

        def derive(cell: Expr, wrt: Sequence[Param]) -> list[Expr]:
            return flatten(compiled_outputs(cell, wrt, 1, task.estimator, task.elimination)[1])

        found: list[Output] = [output_of(on_cells(task.computed(leaf), normal)) for leaf in entries] if wanted.values else []
        sources = list(moved) if wanted.orders and (wanted.values or not wanted.along) else []
        sources += [self._tangent(leaf, wanted) for leaf in entries] if wanted.along else []
        exact = task.estimator.name == "exact"
        for source in sources:
            last = tables and bool(nodes_of(Partition, source))  # nothing else has a last derivative of its own
            slopes = self._slopes.get((source, last), partial(gradient, source, task.wrt, derive, exact, last))
            for p, slope in zip(task.wrt, slopes, strict=True):
                slope = task.computed(slope)
                if slope.has_delta:  # a tangent is also a value, as a factor of another derivative
                    slope = on_cells(slope, normal)
                found.append((p, slope) if isinstance(p, Array) else slope)
        return found

    def _second_along_edges(self, entries: Sequence[Expr], wanted: Wanted) -> list[Output]:
        """Returns the derivatives of gradients along a direction, in which gaps between candidates move. Raises Refused."""
        task = self.task
        if len(wanted.along) > 1:
            raise Refused("it is differentiated more than twice")
        followed = [n for n in postorder([task.expression]) if isinstance(n, Uncovered)]
        beside = replaced([task.expression], dict.fromkeys(followed, ZERO))[0]
        if any(n.has_still_conditions for n in followed) or has_still(beside):
            raise Refused("it has conditions that do not move")
        (direction,) = self.directions(wanted)

        def derive(cell: Expr, wrt: Sequence[Param]) -> list[Expr]:
            return flatten(compiled_outputs(cell, wrt, 1, task.estimator, Elimination(task.maps, closed_forms=False))[1])

        found: list[Output] = []
        for entry in entries:
            for p, slope in zip(task.wrt, gradient(entry, task.wrt, derive), strict=True):
                rate = task.computed(tangent(released(slope), direction, rates_along_edges(derive)))
                found.append((p, rate) if isinstance(p, Array) else rate)
        return found

    def _tangent(self, leaf: Expr, wanted: Wanted) -> Expr:
        for direction in self.directions(wanted):
            moved = tangent(
                leaf,
                direction,
                lambda cell, changes: jvp(cell, changes, self.task.maps),
                self.task.estimator.name == "exact",
            )
            leaf = self._without_deltas(moved)
        return leaf

    def _without_deltas(self, e: Expr) -> Expr:
        """Returns a tangent that is to be differentiated again; if discontinuities are ignored, without their contributions."""
        return on_cells(e, ignore_discontinuities) if isinstance(self.task.estimator, Ignore) else e


class Followed(NamedTuple):
    """A program, what integrals over what candidates do not cover are along the edges of these, and the gradient of each entry."""

    expression: Expr
    edges: Mapping[Node, Expr] = {}
    slopes: Mapping[Expr, list[Expr]] = {}


def followed(e: Expr, wrt: Sequence[Parameter]) -> Followed:
    """Returns a program whose candidates are followed along their edges. If values, or derivatives by these parameters, cannot be computed
    so, candidates are written out. Raises NeedsLengths."""

    def derive(cell: Expr, wrt: Sequence[Param]) -> list[Expr]:
        return flatten(compiled_outputs(cell, wrt, 1, ESTIMATORS["exact"])[1])

    if not nodes_of(Uncovered, e):
        return Followed(e)
    try:
        apart = with_alternatives_apart(e)
        edges = values_along_edges(apart, derive)
        return Followed(apart, edges, {entry: gradient(entry, wrt, derive) for entry in (flatten(apart) if wrt else ())})
    except Refused as refused:
        return Followed(without_uncovered(e, refused.reason))


def has_loops(e: Expr, leaves: Sequence[Param | ArrayName], integers: Sequence[Param]) -> bool:
    """Returns whether a program is one of loops. One that no longer reads its arrays is one too: they are arguments of its calls."""
    return has_arrays(e) or any(isinstance(p, ArrayName) for p in leaves) or bool(integers)


def derivation_of(task: Task) -> Derivation:
    """Returns the derivation of a task: that of another plan with the same task, if there is one.

    Candidates of the task are followed along their edges, if they can be.
    """
    with _lock:
        found = _derivations.get(task)
    if found is not None:
        log.debug("a derivation is shared with another program")
        return found
    own, slopes = task, None
    if has_loops(task.expression, task.leaves, task.integers):
        expression, edges, slopes = followed(task.expression, task.wrt)
        own = replace(task, expression=expression, edges=tuple(edges.items()))
    made = Derivation(own, slopes)
    with _lock:
        return _derivations.setdefault(task, made)


_derivations: weakref.WeakValueDictionary[Task, Derivation] = weakref.WeakValueDictionary()
_lock = threading.Lock()
