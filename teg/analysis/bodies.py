"""The meaning of applications `Apply`: the bodies of functions and of their derivatives, and expressions with these bodies substituted."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import TypeVar, cast

from teg.analysis.calculus import slope
from teg.errors import DeltaError
from teg.ir.cells import replaced
from teg.ir.expr import Call, Expr, Param, Var
from teg.ir.function import Apply, Function, degrees_in
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import call
from teg.ir.traverse import fresh, rebuild, substitute

N = TypeVar("N", bound=Node)
KEPT = 256
"""Bodies that are remembered: every application of a function asks for the same ones."""


def write_all_out(e: N) -> N:
    """Returns the expression with every application replaced by its body."""
    while any(isinstance(n, Apply) and isinstance(n.callee, Function) for n in postorder([e])):
        e = cast(N, everywhere_written_out([e])[e])
    return e


def everywhere_written_out(roots: Iterable[Node]) -> dict[Node, Node]:
    """Returns a map from each node to the same node without applications. Applications inside the bodies of functions
    are not in the map."""
    new: dict[Node, Node] = {}
    for node in postorder(roots):
        children = tuple(new[c] for c in node.children)
        written = isinstance(node, Apply) and isinstance(node.callee, Function)
        new[node] = written_out(cast(Apply, node), children) if written else rebuild(node, children)
    return new


def written_out(node: Apply, children: tuple[Node, ...]) -> Expr:
    """Returns the body of the applied function with `children` as inputs."""
    variables, body = body_of(cast(Function, node.callee), node.derivative)
    if any(c.has_delta for c in children):
        raise DeltaError("a Dirac delta inside a function has no meaning", node, "a delta may only be added and multiplied")
    return cast(Expr, substitute(body, dict(zip(variables, cast("tuple[Expr, ...]", children), strict=True))))


def with_peaks_outside(node: Apply, children: tuple[Node, ...]) -> Expr | None:
    """Returns f(e, …, exp(q(e, …)), …): the application with its exponentials of quadratic polynomials made visible.

    f and the exponents q are functions themselves. None for a derivative.
    """
    function = cast(Function, node.callee)
    if any(node.derivative):
        return None
    outer, exponents = _without_peaks(function)
    inputs: dict[Expr, Node] = dict(zip(function.inputs, children, strict=True))
    none = (0,) * max(f.arity for f in (outer, *exponents))
    for formal, q in zip(outer.formals[function.formal :], exponents, strict=True):
        inputs[formal] = call("exp", Apply.make((q, none[: q.arity]), tuple(inputs[p] for p in q.inputs)))
    return Apply.make((outer, none[: outer.arity]), tuple(inputs[p] for p in outer.inputs))


@lru_cache(maxsize=KEPT)
def _without_peaks(function: Function) -> tuple[Function, list[Function]]:
    """Returns a function with one more argument for each exponential of a quadratic polynomial, and the exponents as functions."""
    body = write_all_out(function.body)
    order = postorder([body])
    degrees = degrees_in(order, function.formals)
    peaks = [n for n in order if isinstance(n, Call) and n.name == "exp" and degrees[n.children[0]] == 2]
    taken = {n for n in order if isinstance(n, Var)} | {Var.make(p.name, ()) for p in function.inputs}
    formals: list[Var] = []
    for _ in peaks:
        formals.append(fresh("peak", taken))
        taken.add(formals[-1])
    outer = replaced([body], dict(zip(peaks, formals, strict=True)))[0]
    exponents = [Function.make((f"exponent of {function.title}", function.formals, False), (n.children[0],)) for n in peaks]
    return Function.make((function.title, (*function.formals, *formals), function.inline), (outer,)), exponents


@lru_cache(maxsize=KEPT)
def body_of(function: Function, derivative: tuple[int, ...]) -> tuple[tuple[Var, ...], Expr]:
    """Returns the inputs of a derivative as variables, and its body, computed from that of one order less."""
    if not any(derivative):
        return _in_variables(function)
    i = max(j for j, k in enumerate(derivative) if k)
    variables, lower = body_of(function, (*derivative[:i], derivative[i] - 1, *derivative[i + 1 :]))
    return variables, slope(lower, variables[i])


def _in_variables(function: Function) -> tuple[tuple[Var, ...], Expr]:
    """Returns the inputs as variables that occur nowhere else in the body, and the body in these variables."""
    bound = {n.var for n in postorder([function.body]) if isinstance(n, Integral)}
    taken = bound | {p for p in function.inputs if isinstance(p, Var)}
    variables: list[Var] = []
    for p in function.inputs:
        variables.append(p if isinstance(p, Var) and p not in bound else fresh(p.name, taken))
        taken.add(variables[-1])
    pairs = list(zip(function.inputs, variables, strict=True))
    body = replaced([function.body], {p: v for p, v in pairs if isinstance(p, Param)})[0]
    moved = {p: v for p, v in pairs if isinstance(p, Var) and p is not v}
    return tuple(variables), cast(Expr, substitute(body, moved)) if moved else body
