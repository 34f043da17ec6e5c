"""Points and weights of the quadrature that a program uses: `Evaluator.nodes`.

Each integrand is multiplied by an unknown smooth function g of the variables of integration, a `teg.function` whose body no pass looks
into. The program of Σ ∫ integrand·g calls g at its nodes; the interpreter notes where, and with which weights (`interpreter/nodes.py`).

An entry of an array V is moved by a parameter: V becomes V + τ·U, where U is 1 at the entry's place and 0 elsewhere, and τ is 0.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from teg.analysis.bodies import write_all_out
from teg.errors import AccuracyError, ArrayIndexError, OperandError, ParameterError
from teg.evaluator.arguments import Call, read_call
from teg.evaluator.counting import Counting
from teg.evaluator.kept import Kept
from teg.evaluator.options import Options
from teg.evaluator.plan import Plan
from teg.evaluator.wanted import GRADIENT_ALONE, VALUE
from teg.ir.arrays import Array, Gather, has_arrays
from teg.ir.cells import with_lengths
from teg.ir.expr import Expr, Param, Tuple, Var
from teg.ir.function import function
from teg.ir.index import ArrayName, IndexConst
from teg.ir.integral import Integral
from teg.ir.node import Node
from teg.ir.simplify import add, mul
from teg.ir.simplify import call as call_of
from teg.ir.traverse import rewrite
from teg.passes.differentiate.through_sums import Parameter, outlined
from teg.passes.normalise.sums import NeedsLengths
from teg.pipeline import diff
from teg.program import Program
from teg.program.arrays import ArrayProgram, Run, steps
from teg.program.interpreter.nodes import Nodes, nodes_of

if TYPE_CHECKING:
    import numpy as np

LINEARITY = 1e-9
"""The sum of the weights may differ from the output by so much, relative to both."""
ROOM = 2**10
"""The largest number of places for roots that is tried."""


def moved_by(by: object, leaves: Sequence[Param | ArrayName]) -> Parameter | None:
    """Returns the parameter of a name or of itself, the array of an entry, None for None. Raises ParameterError for anything else."""
    moved = {p.name: p for p in leaves if isinstance(p, Param)}
    if by is None:
        return None
    if isinstance(by, Gather) and by.array in leaves:
        if all(isinstance(place, IndexConst) for place in by.subscripts):
            return by.array
        raise ParameterError(f"{by} has an index that is no number", None, "by=V[3, 0] names one entry")
    name = by.name if isinstance(by, Param) else by
    if isinstance(name, str) and name in moved:
        return moved[name]
    arrays = [p for p in leaves if isinstance(p, Array)]
    if name in [p.name for p in arrays] or name in arrays:
        what = f"{name.name if isinstance(name, Array) else name!r} is an array"
        raise ParameterError(what, None, "by=V[3, 0] is the derivative by one entry")
    hint = "parameters: " + ", ".join([*moved, *(f"entries of {p.name}" for p in arrays)])
    raise ParameterError(f"there is no parameter {name!r} to differentiate by", None, hint if moved or arrays else "")


class NodeFinder:
    """The program of an expression, or of its derivative, times an unknown function. Raises OperandError if it has no nodes.

    `by` is a parameter, or an array for derivatives by its entries.
    """

    def __init__(self, e: Expr, by: Parameter | None, options: Options, leaves: Sequence[Param | ArrayName]) -> None:
        self.expression = e
        self._array = by if isinstance(by, Array) else None
        if isinstance(by, Array):
            taken = {p.name for p in leaves}
            mark = "∂" * (1 + max((len(name) - len(name.lstrip("∂")) for name in taken), default=0))
            self._unit, self._shift = Array.make((mark + by.name, by.dimensions), ()), Param.make(mark, ())
            e, leaves, by = shifted(e, by, self._shift, self._unit), [*leaves, self._shift, self._unit], self._shift
        self._probed, self.variables = with_unknown_factor(e)
        self._by, self._options, self._leaves = by, options, leaves
        self._loops = has_arrays(e) or any(isinstance(p, ArrayName) for p in leaves)
        self._how = replace(options.integration, intrinsics=False)
        self._plans: Kept[tuple[object, ...] | None, Plan] = Kept()
        self._counting: Kept[None, Counting] = Kept(1)

    def nodes(self, values: Mapping[str, Any], integers: Collection[str], by: object) -> tuple[np.ndarray, np.ndarray]:
        """Returns the points, (batch, n, variables), and the weights, (batch, n), `by` an entry if the finder is for an array."""
        import numpy as np

        if isinstance(by, Gather):
            values = {**values, self._shift.name: 0.0, self._unit.name: unit_at(by, values[by.array.name])}
        call = read_call(self._leaves, values, integers, "float64")
        if self._loops:
            call.check(cast(ArrayProgram, self._program(call)))
        columns = [np.broadcast_to(column, call.n) for column in call.doubles]
        rows = [self._at(call, i, [float(column[i]) for column in columns]) for i in range(call.n)]
        if self._array is not None:
            rows = [without_zeros(row) for row in rows]  # of the terms in which the entry does not stand
        most = max((len(row.weights) for row in rows), default=0)
        points, weights = np.zeros((call.n, most, len(self.variables))), np.zeros((call.n, most))
        for i, row in enumerate(rows):
            if row.weights:
                points[i] = row.points[-1]
                points[i, : len(row.points)] = row.points
                weights[i, : len(row.weights)] = row.weights
        return points.reshape(*call.shape, most, len(self.variables)), weights.reshape(*call.shape, most)

    def _at(self, call: Call, element: int, arguments: Sequence[float]) -> Nodes:
        """Returns the nodes of an element of the batch. Raises OperandError where the weights are not those of the output."""
        arrays = [a if a.ndim == len(own) else a[element] for a, own in zip(call.arrays, call.shapes, strict=True)]
        found = nodes_of(self._program(call), arguments, arrays)
        while found.crowded and self._how.max_roots < ROOM:
            self._how = replace(self._how, max_roots=2 * self._how.max_roots)
            found = nodes_of(self._program(call), arguments, arrays)
        sizes = sum(map(abs, found.weights)) + abs(found.output)
        if found.missed or not sizes < float("inf"):
            raise AccuracyError("the nodes at these values miss the tolerance", self.expression, "a larger tol=")
        if abs(sum(found.weights) - found.output) > LINEARITY * sizes:
            raise OperandError("this is no sum of integrals with factors, so it has no nodes", self.expression, HINT)
        return found

    def _program(self, call: Call) -> Program | ArrayProgram:
        """Returns the program, made for the lengths of the arrays only if it must be."""
        wanted = GRADIENT_ALONE if self._loops and self._by is not None else VALUE
        try:
            program = self._plan(None).program(wanted, how=self._how)
        except NeedsLengths:
            program = self._plan(call).program(wanted, how=self._how)
        parts = [program] if isinstance(program, Program) else [s.program for s in steps(program.body) if isinstance(s, Run)]
        if any(any(f.derivative) for part in parts for f in part.functions):
            what = "this derivative moves the nodes along, so it is no sum over nodes"
            raise OperandError(what, self.expression, "it is so where an integrand is singular on a surface that moves")
        return program

    def _plan(self, call: Call | None) -> Plan:
        """Returns the plan for any lengths of arrays, or for those, and the numbers of candidates, of a call."""

        def made() -> Plan:
            e, by, options = self._probed, self._by, self._options
            if not self._loops:
                return Plan(e if by is None else diff(e, by, options.maps), options, (), self._leaves)
            if call is not None:
                e = with_lengths(counting.bounded(counts), dict(zip(named, call.shapes, strict=True)))
            return Plan(outlined(e), options, () if by is None else (by,), self._leaves)

        if call is None:
            return self._plans.get(None, made)
        named = [leaf for leaf in self._leaves if isinstance(leaf, ArrayName)]
        counting = self._counting.get(None, lambda: Counting(self._probed))
        given = {**dict(zip(call.names, call.columns, strict=True)), **{a.name: v for a, v in zip(named, call.arrays, strict=True)}}
        counts = counting.of(given)
        return self._plans.get((tuple(call.shapes), counts), made)


def shifted(e: Expr, array: Array, shift: Param, unit: Array) -> Expr:
    """Returns the expression with V[i] + shift·unit[i] for every entry V[i] of an array."""

    def visit(old: Node, new: Node) -> Node:
        if type(old) is not Gather or old.array is not array:
            return new
        return add(cast(Expr, new), mul(shift, Gather.make((unit, old.subscripts), ())))

    return cast(Expr, rewrite([e], visit)[e])


def without_zeros(row: Nodes) -> Nodes:
    """Returns the nodes whose weights are not 0."""
    kept = [k for k, weight in enumerate(row.weights) if weight]
    return replace(row, points=[row.points[k] for k in kept], weights=[row.weights[k] for k in kept])


def unit_at(entry: Gather, value: Any) -> np.ndarray:
    """Returns the array that is 1 at an entry's place and 0 elsewhere, of the shape of a value (of the axes behind a batch)."""
    import numpy as np

    array, place = entry.array, tuple(cast(int, cast(IndexConst, index).data) for index in entry.subscripts)
    unit = np.zeros(np.shape(value)[-array.dimensions :])
    if unit.ndim != array.dimensions or any(k >= n for k, n in zip(place, unit.shape, strict=True)):
        raise ArrayIndexError(f"there is no {entry} in an array of the shape {np.shape(value)}", entry)
    unit[place] = 1
    return unit


HINT = "teg.integral(…), sums of such, and these times parameters have nodes"


def with_unknown_factor(e: Expr) -> tuple[Expr, tuple[Var, ...]]:
    """Returns the expression with each outermost integral's integrand times an unknown function of its variables, and the variables.

    Raises OperandError for tuples, expressions without integrals, and integrals over different variables.
    """
    if isinstance(e, Tuple):
        raise OperandError("a tuple has no nodes", e, "compile one entry")
    e = write_all_out(e)
    chains = {top: _chain(top) for top in _outermost(e)}
    variables = {tuple(node.var for node in reversed(chain)) for chain in chains.values()}
    if len(variables) != 1:
        names = " and ".join("(" + ", ".join(v.name for v in each) + ")" for each in variables)
        what = f"the integrals are over {names}" if variables else "there is no integral"
        raise OperandError(f"{what}, so there are no nodes", e, HINT)
    (order,) = variables
    unknown = function("unknown", order, call_of("exp", add(*order)), inline=False)
    factor = unknown(*order)
    innermost = {chain[-1] for chain in chains.values()}

    def visit(old: Node, new: Node) -> Node:
        if old not in innermost:
            return new
        new = cast(Integral, new)
        return Integral.make(new.data, (mul(new.body, factor), new.lo, new.hi))

    return cast(Expr, rewrite([e], visit)[e]), order


def _outermost(e: Expr) -> list[Integral]:
    """Returns the integrals that are in no other one."""
    stack: list[Node] = [e]
    seen: set[Node] = set()
    found: dict[Integral, None] = {}
    while stack:
        node = stack.pop()
        if isinstance(node, Integral):
            found[node] = None
        elif node not in seen:
            seen.add(node)
            stack += node.children
    return list(found)


def _chain(top: Integral) -> list[Integral]:
    """Returns an integral, the one that is its integrand, and so on, outermost first."""
    chain = [top]
    while isinstance(chain[-1].body, Integral):
        chain.append(chain[-1].body)
    return chain
