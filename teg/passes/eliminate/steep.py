"""Graphs y = f(x) that may be so steep that the chart over x does not resolve them.

A surface with a number for a slope in y, g = c·y + h(x), is the graph of a function: it meets every x once, and the chart over x needs
no roots. But y runs through its range while x moves by |c|·Y/|gₓ|, and the ends of that window are known to the rounding of x only: if
it is 1/R of the range of x, ε·R of the result is lost, and with R > 1/ε all of it. So with

    R = max |gₓ|·X over the box, divided by the largest |c|·Y of the variables that g is affine in

the surface is a graph if R <= STEEPEST, and otherwise one of `teg.passes.eliminate.implicit`, which has a chart for every variable. R is
an expression of the parameters. If it is a number, the choice is made at compile time. Else parameters are taken to be of ordinary size,
1/10 to 10: if R is then moderate at all sample points, or large at all of them, this decides; otherwise one condition on parameters
decides in every call. Both forms in every program would make ordinary ones slower in JAX, which evaluates both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.evaluate import values_of
from teg.analysis.intervals import Enclosure
from teg.analysis.nest import Binder, Chain, nest, ranges_of
from teg.analysis.surfaces import free_of
from teg.errors import NotDifferentiableError, OperandError
from teg.ir.expr import FALSE, TRUE, ZERO, Call, Cond, Const, Expr, Pow, Var, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, mul, negation, positive, sub, where
from teg.ir.traverse import parameters
from teg.numerics.field import residue
from teg.passes.eliminate.affine import Affine, rewrite_affine
from teg.passes.eliminate.implicit import Implicit, match_implicit, rewrite_implicit

STEEPEST = 1e4
"""The largest R for which a surface is a graph: it then loses at most a few roundings times this number."""
MODERATE = 1e6
"""The largest R for which a graph is kept without a condition: its loss is within the tolerance."""
SAMPLES = 16
"""The number of points at which R is evaluated, each with parameters of its own."""
LARGEST = 2_000
"""The largest number of nodes of R. A longer condition costs more than the chart."""
MAY_FAIL = frozenset(("log", "log1p", "erfinv", "erfcinv", "sqrt", "asin", "acos", "pow", "atan2", "tan", "mod", "floor"))
"""Functions that are not defined, or not bounded, everywhere: R may be NaN, and would then make the result NaN."""


@dataclass(frozen=True)
class Graph:
    """A graph, affine as `graph` says, that `steep` replaces where the condition `too_steep` holds."""

    variables: tuple[Var, ...]
    graph: Affine
    steep: Implicit
    too_steep: Cond

    name = "affine, isolated at run time where it is steep"
    moves = False


def steepness(g: Expr, graph: Affine, boxes: Sequence[Binder]) -> Cond:
    """Returns the condition R > STEEPEST, FALSE also if R is not known. `boxes` are the integrals over the variables
    of g, outermost first."""
    ranges = ranges_of(boxes)
    if ranges is None or any(isinstance(e, Const) and math.isinf(e.data) for ends in ranges for e in ends):
        return FALSE
    box = {b.var: ends for b, ends in zip(boxes, ranges, strict=True)}
    extents = {v: _size(sub(hi, lo)) for v, (lo, hi) in box.items()}
    try:
        rates = {v: slope(g, v) for v in box}
        others = [mul(_largest(Enclosure(_ordered(box)), rates[v]), extents[v]) for v in box if v not in graph.variables]
    except NotDifferentiableError:
        return FALSE
    own = [mul(const(STEEPEST), const(abs(cast(Const, rates[v]).data)), extents[v]) for v in graph.variables if isinstance(rates[v], Const)]
    ratio = _most(others), _most(own)
    sizes = _samples(*ratio)
    if sizes is None or all(r <= (MODERATE if parameters(add(*ratio)) else STEEPEST) for r in sizes):
        return FALSE
    if all(r > STEEPEST for r in sizes):
        return TRUE
    nodes = postorder(ratio)
    if len(nodes) > LARGEST or any(_may_fail(n) for n in nodes):
        return FALSE
    return positive(sub(*ratio))


def _may_fail(n: Node) -> bool:
    return (isinstance(n, Call) and n.name in MAY_FAIL) or (isinstance(n, Pow) and n.exponent < 0)


def _samples(above: Expr, below: Expr) -> list[float] | None:
    """Returns R = STEEPEST·above/below at the sample points, or None if it is not known at one of them."""
    values: dict[Expr, list[float]] = {}
    for p in parameters(add(above, below)):
        sizes = [residue("size", p.name, k) % 2**32 / 2**32 for k in range(SAMPLES)]
        values[p] = [(10.0 ** (2.0 * s - 1.0)) * (1.0 if residue("sign", p.name, k) % 2 else -1.0) for k, s in enumerate(sizes)]
    try:
        pairs = [values_of([above, below], {p: numbers[k] for p, numbers in values.items()}) for k in range(SAMPLES if values else 1)]
    except OperandError:
        return None
    ratios = [STEEPEST * float(a) / float(b) if b else math.inf for a, b in pairs]
    return None if any(math.isnan(r) for r in ratios) else ratios


def match_steep(g: Expr, graph: Affine, boxes: Sequence[Binder]) -> Implicit | Graph | None:
    """Returns the replacement of a graph that is, or at run time may be, too steep; None if the graph may stay.
    `boxes` as in `steepness`."""
    too_steep = steepness(g, graph, boxes)
    steep = None if too_steep is FALSE else match_implicit(g, [b.var for b in reversed(boxes)])
    if steep is None or too_steep is TRUE:
        return steep
    mine = {*graph.variables, *steep.variables}
    return Graph(tuple(b.var for b in boxes if b.var in mine), graph, steep, too_steep) if free_of(too_steep, mine) else None


def rewrite_steep(g: Expr, coefficient: Expr, chain: Chain, data: Graph) -> Expr | None:
    """Returns the graph, or the charts of an implicit surface, depending on the condition; the graph alone if the
    charts are not possible."""
    flat = _from(g, coefficient, chain, data.graph)
    charts = None if coefficient.has_delta else _from(g, coefficient, chain, data.steep)
    if flat is None or charts is None:
        return flat
    return add(where(negation(data.too_steep), flat, ZERO), where(data.too_steep, charts, ZERO))


def _from(g: Expr, coefficient: Expr, chain: Chain, data: Affine | Implicit) -> Expr | None:
    """Returns the rewriting of the part of a chain from the outermost variable of the data inwards, inside the outer part of the chain."""
    first = next(i for i, b in enumerate(chain) if b.var in data.variables)
    if isinstance(data, Affine):
        inner = rewrite_affine(g, coefficient, chain[first:], data)
    else:
        inner = rewrite_implicit(g, coefficient, chain[first:], data)
    return None if inner is None else nest(inner, chain[:first])


def _ordered(box: dict[Var, tuple[Expr, Expr]]) -> dict[Var, tuple[Expr, Expr]]:
    """Returns the ranges with their smaller end first."""
    return {
        v: (lo, hi) if isinstance(hi, Const) and isinstance(lo, Const) and lo.data <= hi.data else _sorted(lo, hi)
        for v, (lo, hi) in box.items()
    }


def _sorted(lo: Expr, hi: Expr) -> tuple[Expr, Expr]:
    return call("min", lo, hi), call("max", lo, hi)


def _largest(enclosure: Enclosure, e: Expr) -> Expr:
    """Returns the largest |e| over a box."""
    lo, hi = enclosure.of(e)
    return _most([_size(lo), _size(hi)])


def _size(e: Expr) -> Expr:
    return const(abs(e.data)) if isinstance(e, Const) else call("magnitude", e)


def _most(values: Sequence[Expr]) -> Expr:
    result = values[0]
    for v in values[1:]:
        result = const(max(result.data, v.data)) if isinstance(result, Const) and isinstance(v, Const) else call("max", result, v)
    return result
