"""Choices among data: any, all, products, and the nearest of candidates.

    e ::= … | Π[k: i..i] e | nearest[k: i..i](e; e | b; e)    product; value, key, condition, and the value where there is no candidate
    b ::= … | any[k: i..i] b                                  all is ~any ~

These are what users write. `teg.passes.normalise.choices` turns them into what is compiled: integrals become partitions
(`partition.py`), the others sums over an index that is compared with a `Winner`.

    e ::= … | winner[k: i..i](e, e)                           the index of the least key among candidates whose second number is 1
"""

from __future__ import annotations

import math
from typing import TypeAlias, cast, overload

from teg.errors import ArrayIndexError, OperandError, ScopeError
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.arrays import Range, Ranged, open_indices
from teg.ir.expr import MINUS_ONE, Cond, Const, Expr, Operand, Tuple
from teg.ir.index import Index, IndexConst, IndexVar, as_index, index_leaves
from teg.ir.operands import as_condition, as_number, refuse_list
from teg.ir.simplify import mul, negation

NOTHING = ex.const(math.nan)
"""The value of a choice from nothing, if the program says no other."""


class Nearest(Ranged, Expr):
    """The value at the index whose key is least among those where a condition holds; children: value, key, condition, otherwise."""

    __slots__ = ()

    @property
    def value(self) -> Expr:
        return cast(Expr, self.children[0])

    @property
    def key(self) -> Expr:
        return cast(Expr, self.children[1])

    @property
    def condition(self) -> Cond:
        return cast(Cond, self.children[2])

    @property
    def otherwise(self) -> Expr:
        return cast(Expr, self.children[3])


class AnyOf(Ranged, Cond):
    """Whether a condition holds for any index."""

    __slots__ = ()

    @property
    def condition(self) -> Cond:
        return cast(Cond, self.children[0])


class Product(Ranged, Expr):
    """Π body over an index."""

    __slots__ = ()

    @property
    def body(self) -> Expr:
        return cast(Expr, self.children[0])


class Winner(Ranged, Expr):
    """The index, as a number, of the least key among candidates whose second child is 1; -1 if there is none. It has derivative 0."""

    __slots__ = ()


CHOICES = (Nearest, AnyOf, Product)

# -- what users call ---------------------------------------------------------------------------------------------------


def any_(condition: Cond, *ranges: Range) -> Cond:
    """Returns the condition that `condition` holds for any index of the triples (index, first, end); `end` is excluded.

    Over an empty range it is false. A condition that is NaN for one index makes it NaN. Raises ScopeError for a malformed triple,
    ArrayIndexError for a bound that is not an integer.

        x, y = teg.vars("x y")
        k, C = teg.index("k"), teg.array("C", 2)
        inside = teg.any((abs(x - C[k, 0]) < 0.1) & (abs(y - C[k, 1]) < 0.1), (k, 0, teg.length(C, 0)))
        f = teg.compile(teg.integral(teg.bracket(inside), (x, 0, 1), (y, 0, 1)))
        round(float(f(C=[[0.3, 0.3], [0.4, 0.4]])), 12)      # 0.07: the area of the union of two squares
    """
    refuse_list(condition, "any", "c | d joins conditions")
    c = as_condition(condition)
    for k, lo, hi in _ranges(ranges, c, "any"):
        c = AnyOf.make((k, lo, hi), (c,))
    return c


def all_(condition: Cond, *ranges: Range) -> Cond:
    """Returns the condition that `condition` holds for every index of the triples (index, first, end); `end` is excluded.

    Over an empty range it is true. A condition that is NaN for one index makes it NaN. Raises as `teg.any` does.

        k, V = teg.index("k"), teg.array("V")
        f = teg.compile(teg.bracket(teg.all(V[k] > 0, (k, 0, teg.length(V)))))
        float(f(V=[1.0, 2.0]))                               # 1.0
    """
    refuse_list(condition, "all", "c & d joins conditions")
    return negation(any_(negation(as_condition(condition)), *ranges))


@overload
def prod(factor: Tuple, *ranges: Range) -> Tuple: ...
@overload
def prod(factor: Operand, *ranges: Range) -> Expr: ...
def prod(factor: Operand, *ranges: Range) -> Expr:
    """Returns the product of `factor` over the triples (index, first, end), the first triple innermost; `end` is excluded.

    Over an empty range it is 1. A derivative costs the square of the number of factors, and is right where factors are 0. A tuple is
    multiplied entry by entry. Raises as `teg.any` does.

        k, V = teg.index("k"), teg.array("V")
        f = teg.compile(teg.prod(V[k], (k, 0, teg.length(V))))
        value, gradient = f.value_and_grad(V=[2.0, 0.0, 5.0])
        gradient["V"].tolist()                               # [0.0, 10.0, 0.0]
    """
    refuse_list(factor, "prod", "math.prod(…) multiplies a list")
    e = factor if isinstance(factor, Tuple) else as_number(factor)
    triples = _ranges(ranges, e, "prod")
    if isinstance(e, Tuple):
        return simplify.tuple_of(*(prod(entry, *ranges) for entry in e.children))
    for k, lo, hi in triples:
        e = Product.make((k, lo, hi), (e,))
    return e


Values: TypeAlias = "Operand | tuple[Operand, ...] | list[Operand]"
"""The type of one value or of several."""


@overload
def nearest(
    value: Tuple | tuple[Operand, ...], key: Operand, over: Range, *, where: Cond | None = None, otherwise: Values = NOTHING
) -> Tuple: ...
@overload
def nearest(value: Operand, key: Operand, over: Range, *, where: Cond | None = None, otherwise: Values = NOTHING) -> Expr: ...
def nearest(value: Values, key: Operand, over: Range, *, where: Cond | None = None, otherwise: Values = NOTHING) -> Expr:
    """Returns `value` at the index of the triple (index, first, end) whose `key` is least among those where the condition `where` holds.

    Ties go to the lower index. Where there is no candidate it is `otherwise`; without that argument NaN, of which a call warns. A key
    that is NaN makes it NaN. `value` may be a tuple (`otherwise` too): one choice of several values. Raises ScopeError for a malformed
    triple, or if `otherwise` depends on the index; ArrayIndexError for a bound that is not an integer, or a range without indices.

        x = teg.var("x")
        k, S = teg.index("k"), teg.array("S")
        cell = teg.nearest(k, (x - S[k]) ** 2, (k, 0, teg.length(S)))       # the number of the nearest site
        f = teg.compile(teg.integral(cell, (x, 0, 1)))
        value, gradient = f.value_and_grad(S=[0.2, 0.6])
        round(float(value), 12), gradient["S"].round(12).tolist()           # (0.6, [-0.5, -0.5])
    """
    values = value.children if isinstance(value, Tuple) else value if isinstance(value, tuple | list) else None
    if values is not None:
        others = otherwise.children if isinstance(otherwise, Tuple) else otherwise if isinstance(otherwise, tuple | list) else None
        if others is not None and len(others) != len(values):
            raise OperandError(f"teg.nearest has {len(values)} values and {len(others)} of otherwise", None, "one of each")
        pairs = zip(values, others if others is not None else [otherwise] * len(values), strict=True)
        return simplify.tuple_of(*(nearest(v, key, over, where=where, otherwise=o) for v, o in pairs))
    chosen, by, last = as_number(value), as_number(key), as_number(otherwise)
    ((k, lo, hi),) = _ranges((over,), by, "nearest")
    if k in open_indices(last)[last]:
        raise ScopeError(f"what stands where nothing is nearest depends on {k.name}, the index of the candidates", last)
    if last is NOTHING and isinstance(lo, IndexConst) and lo is hi:
        raise ArrayIndexError(f"there is nothing to choose from: the range of {k.name} is empty", by, "otherwise= gives the value")
    condition = ex.TRUE if where is None else as_condition(where)
    return Nearest.make((k, lo, hi), (chosen, by, condition, last))


def minimum_of(key: Operand, over: Range, *, where: Cond | None = None, otherwise: Operand = NOTHING) -> Expr:
    """Returns the least `key` over the triple (index, first, end) among those where the condition `where` holds.

    Where there is none it is `otherwise`; without that argument NaN. Raises as `teg.nearest` does.

        k, V = teg.index("k"), teg.array("V")
        f = teg.compile(teg.minimum_of(V[k], (k, 0, teg.length(V))))
        float(f(V=[3.0, 1.0, 2.0]))                          # 1.0
    """
    return nearest(key, key, over, where=where, otherwise=otherwise)


def maximum_of(key: Operand, over: Range, *, where: Cond | None = None, otherwise: Operand = NOTHING) -> Expr:
    """Returns the largest `key` over the triple (index, first, end) among those where the condition `where` holds.

    Where there is none it is `otherwise`; without that argument NaN. Raises as `teg.nearest` does.

        k, V = teg.index("k"), teg.array("V")
        f = teg.compile(teg.maximum_of(V[k], (k, 0, teg.length(V)), where=V[k] < 2.5))
        float(f(V=[3.0, 1.0, 2.0]))                          # 2.0
    """
    return nearest(key, mul(MINUS_ONE, as_number(key)), over, where=where, otherwise=otherwise)


def _ranges(ranges: tuple[object, ...], e: object, what: str) -> list[tuple[IndexVar, Index, Index]]:
    """Returns triples (index, first, end), checked."""
    if not ranges:
        raise ScopeError(f"teg.{what} needs an index and its range", e, f"write teg.{what}(…, (k, 0, n))")
    triples: list[tuple[IndexVar, Index, Index]] = []
    for triple in ranges:
        if not isinstance(triple, tuple | list) or len(triple) != 3:
            raise ScopeError(f"{triple!r:.80} is not (index, first, end)", e, f"write teg.{what}(…, (k, 0, n))")
        k, lo, hi = triple
        if not isinstance(k, IndexVar):
            raise ScopeError(f"teg.{what} runs over an index, not over {type(k).__name__} {k!s:.80}", e, 'make one with k = teg.index("k")')
        first, end = as_index(lo, e), as_index(hi, e)
        if isinstance(first, IndexConst) and isinstance(end, IndexConst) and end.data < first.data:
            raise ArrayIndexError(f"the range of {k.name} has a negative length: from {first.data} to {end.data}", e)
        if k in index_leaves([first, end]):
            raise ScopeError(f"the range of {k.name} depends on {k.name} itself", e, "bounds may depend on the indices further out")
        triples.append((k, first, end))
    return triples


def is_nothing(e: Expr) -> bool:
    """Returns whether an expression is the number NaN."""
    return isinstance(e, Const) and math.isnan(e.data)
