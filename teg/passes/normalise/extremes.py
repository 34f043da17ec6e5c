"""Maxima and minima of many written-out functions in an integral as choices over the rows of a table.

    ∫ max(l₁, max(l₂, … lₙ)) dx   →   ∫ max_k l(T[k]) dx         a partition of the box (`teg.passes.normalise.partitions`)

Written out, a maximum has a kink for every pair of its operands; a partition takes n·log n. Where two operands are equal the one that was
written later counts, as it does in `where(a > b, a, b)`. Only integrals that are partitions are changed: affine operands over a box of
one or two variables, in a polynomial. Cost: a visit a node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.calculus import slope
from teg.errors import ArrayIndexError, NotDifferentiableError
from teg.ir.arrays import Array, Gather
from teg.ir.cells import rename_indices, replaced
from teg.ir.choices import NOTHING, Nearest
from teg.ir.expr import MINUS_ONE, TRUE, ZERO, Compare, Const, Expr, Param, Var, Where
from teg.ir.index import IndexVar, index_const
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, mul
from teg.ir.traverse import substitute
from teg.passes.normalise.partitions import Refused, partitioned
from teg.passes.normalise.rows import ROW, Row, Tables, shape_of, template_of

FEWEST = 4
"""Of so many operands a maximum is a partition."""


def with_choices(node: Integral, tables: Tables) -> Expr | None:
    """Returns an integral, and adds tables, with its long maxima and minima as choices; None if it has none, or is no partition then."""
    found: dict[Node, Expr] = {}
    added = dict(tables)
    covered: set[Node] = set()
    for where in postorder([node])[::-1]:  # parents first
        if not isinstance(where, Where) or where in covered or not where.free:
            continue
        if (chain := _operands(where)) is not None and len(chain[1]) >= FEWEST:
            covered.update(postorder([where]))
            choice = _choice(*chain, added)
            if choice is None:
                return None
            found[where] = choice
    if not found:
        return None
    changed = cast(Integral, replaced([node], found)[0])
    try:
        partitioned(cast(Integral, rename_indices(changed)))
    except (Refused, NotDifferentiableError, ArrayIndexError):
        return None
    tables.update(added)
    return changed


def _operands(node: Where) -> tuple[bool, list[Expr]] | None:
    """Returns whether a choice is a maximum, and its operands in their order; None if it is no maximum or minimum."""
    largest = _is_extreme(node)
    if largest is None:
        return None
    operands: list[Expr] = []
    stack: list[Expr] = [node]
    while stack:
        e = stack.pop()
        if isinstance(e, Where) and _is_extreme(e) is largest:
            stack += [e.otherwise, e.then]
        else:
            operands.append(e)
    return largest, operands


def _is_extreme(node: Where) -> bool | None:
    """Returns True for where(a > b, a, b), False for where(a < b, a, b), else None."""
    if not isinstance(node.condition, Compare) or node.condition.resolution is not None:
        return None
    g = node.condition.g
    return True if g is node.then - node.otherwise else False if g is node.otherwise - node.then else None


def _choice(largest: bool, operands: Sequence[Expr], tables: Tables) -> Expr | None:
    """Returns the choice among the rows of a new table."""
    later_first = list(reversed(operands))
    shapes = [shape_of(e) for e in later_first]
    if all(s.key == shapes[0].key for s in shapes):
        value = template_of(list(zip(later_first, shapes, strict=True)), tables)
    else:
        value = _affine(later_first, tables)
    if value is None:
        return None
    key = mul(MINUS_ONE, value) if largest else value
    return Nearest.make((IndexVar.make(ROW, ()), index_const(0), index_const(len(operands))), (value, key, TRUE, NOTHING))


def _affine(operands: Sequence[Expr], tables: Tables) -> Expr | None:
    """Returns c + s·x over the rows (c, s) of a new table, if all operands are of this form, c and s parameters or numbers."""
    variables = {x for e in operands for x in e.free}
    if len(variables) != 1:
        return None
    (x,) = variables
    rows: list[Row] = []
    for e in operands:
        try:
            rate = slope(e, x)
        except NotDifferentiableError:
            return None
        row = cast(Expr, substitute(e, {x: ZERO})), rate
        if not all(isinstance(c, Param | Const) for c in row):
            return None
        rows.append(cast(Row, row))
    table = Array.make((f"table {len(tables)}", 2), ())
    tables[table] = tuple(rows)
    c, s = (Gather.make((table, (IndexVar.make(ROW, ()), index_const(j))), ()) for j in (0, 1))
    return add(c, mul(s, cast(Var, x)))
