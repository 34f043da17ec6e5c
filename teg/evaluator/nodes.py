"""Points and weights of the quadrature that a program uses: `Evaluator.nodes`.

Each integrand is multiplied by an unknown smooth function g of the variables of integration, a `teg.function` whose body no pass looks
into. The program of Σ ∫ integrand·g calls g at its nodes; the interpreter notes where, and with which weights (`interpreter/nodes.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast

from teg.analysis.bodies import write_all_out
from teg.errors import AccuracyError, OperandError
from teg.evaluator.arguments import Call
from teg.evaluator.options import Options
from teg.evaluator.plan import GRADIENT_ALONE, VALUE, Kept, Plan
from teg.ir.arrays import has_arrays
from teg.ir.cells import with_lengths
from teg.ir.expr import Expr, Param, Tuple, Var, add, mul
from teg.ir.expr import call as call_of
from teg.ir.function import function
from teg.ir.index import ArrayName
from teg.ir.integral import Integral
from teg.ir.node import Node
from teg.ir.traverse import rewrite
from teg.passes.differentiate.through_sums import outlined
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


class NodeFinder:
    """The program of an expression, or of its derivative, times an unknown function. Raises OperandError if it has no nodes."""

    def __init__(self, e: Expr, by: Param | None, options: Options, leaves: Sequence[Param | ArrayName]) -> None:
        self.expression = e
        self._probed, self.variables = with_unknown_factor(e)
        self._by, self._options, self._leaves, self._loops = by, options, leaves, has_arrays(e)
        self._how = replace(options.integration, intrinsics=False)
        self._plans: Kept[tuple[tuple[int, ...], ...] | None, Plan] = Kept()

    def nodes(self, call: Call) -> tuple[np.ndarray, np.ndarray]:
        """Returns the points, (batch, n, variables), and the weights, (batch, n)."""
        import numpy as np

        if self._loops:
            call.check(cast(ArrayProgram, self._program(call)))
        columns = [np.broadcast_to(column, call.n) for column in call.doubles]
        rows = [self._at(call, i, [float(column[i]) for column in columns]) for i in range(call.n)]
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
        """Returns the plan for any lengths of arrays, or for those of a call."""

        def made() -> Plan:
            e, by, options = self._probed, self._by, self._options
            if not self._loops:
                return Plan(e if by is None else diff(e, by, options.maps), options, (), self._leaves)
            if call is not None:
                named = [leaf for leaf in self._leaves if isinstance(leaf, ArrayName)]
                e = with_lengths(e, dict(zip(named, call.shapes, strict=True)))
            return Plan(outlined(e), options, () if by is None else (by,), self._leaves)

        return self._plans.get(None if call is None else tuple(call.shapes), made)


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
