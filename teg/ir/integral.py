"""The binder ∫ₗʰ e dx and the distribution δ(e)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from teg.ir.expr import ONE, TRUE, ZERO, Add, And, Call, Compare, Const, Expr, Mul, Tuple, Var, Where, called, calls_of
from teg.ir.node import Node, nodes_of, union
from teg.ir.simplify import conjunction, mul, nonzero_part, sub, tuple_of, where

PARTIAL = frozenset(("asin", "acos", "log", "log1p", "sqrt", "pow", "erfinv", "erfcinv"))
"""Functions that are not defined for all numbers."""
_PARTIAL = called(*PARTIAL)


class Integral(Expr):
    """∫ₗʰ body dx. The bounds are outside the scope of x; lo > hi is the signed integral -∫ₕˡ."""

    __slots__ = ()
    is_integral = True

    @property
    def var(self) -> Var:
        return self.data  # type: ignore[no-any-return]

    @property
    def body(self) -> Expr:
        return self.children[0]  # type: ignore[return-value]

    @property
    def lo(self) -> Expr:
        return self.children[1]  # type: ignore[return-value]

    @property
    def hi(self) -> Expr:
        return self.children[2]  # type: ignore[return-value]

    def _free_variables(self) -> frozenset[Any]:
        inner = self.children[0].free
        if self.data in inner:
            inner = inner - {self.data}
        return union([inner, self.children[1].free, self.children[2].free])


class ClosedForm(Call):
    """A number that an intrinsic computes from its children. Data say which; it has no derivative.

    As a function of an outer variable it is as smooth as its `terms`, but for the zeros of its `kinks` and of its `births`. There are as
    many of these, in this order, as the data say; beside a birth it is like a square root.
    """

    __slots__ = ()

    @property
    def terms(self) -> Sequence[Expr]:
        """The children of which it is a sum."""
        return ()

    @property
    def kinks(self) -> Sequence[Expr]:
        """Functions at whose zeros it turns into another function."""
        return ()

    @property
    def births(self) -> Sequence[Expr]:
        """Functions at whose zeros a part of it begins or ends."""
        return ()


class Delta(Expr):
    """Dirac's δ(g)."""

    __slots__ = ()
    is_delta = True

    @property
    def g(self) -> Expr:
        return self.children[0]  # type: ignore[return-value]


class PointMasses(Expr):
    """Σᵢ δ(x - xᵢ), a unit mass at each root xᵢ of g, in the variable x of the integral around it.

    It replaces a δ(g) whose roots have no formula. ∫ₗʰ w·PointMasses(g) dx is the sum of w over the roots between l and h, which are
    isolated at run time.
    """

    __slots__ = ()

    @property
    def g(self) -> Expr:
        return self.children[0]  # type: ignore[return-value]


def masses_of(e: Expr, var: Var) -> PointMasses | None:
    """Returns the point masses of an integrand over `var`, a factor of it under conditions; None if it has none."""
    stack: list[Expr] = [e]
    seen: set[Expr] = set()
    while stack:
        node = stack.pop()
        if node in seen or var not in node.free:
            continue
        seen.add(node)
        if isinstance(node, PointMasses):
            return node
        if isinstance(node, Where):
            stack += [node.then, node.otherwise]
        elif isinstance(node, Mul | Add):
            stack.extend(node.children)
    return None


def outermost_integrals(roots: Sequence[Node], var: Var) -> list[Integral]:
    """Returns the integrals that depend on `var`, in the order in which they stand, without those inside of others."""
    found: list[Integral] = []
    seen: set[Node] = set()
    stack: list[Node] = list(reversed(roots))
    while stack:
        node = stack.pop()
        if node in seen or var not in node.free:
            continue
        seen.add(node)
        if isinstance(node, Integral):
            found.append(node)
        else:
            stack.extend(reversed(node.children))
    return found


def integral_over(body: Expr, var: Var, lo: Expr, hi: Expr) -> Expr:
    """Returns ∫ₗʰ body dx; 0 if the body or the length of the domain is 0."""
    if isinstance(body, Tuple):
        return tuple_of(*(integral_over(entry, var, lo, hi) for entry in body.children))
    if body is ZERO or (lo is hi and not body.has_delta):
        return ZERO
    return Integral.make(var, (body, lo, hi))


def delta(g: Expr) -> Expr:
    """Returns δ(g), which is 0 for a number g that is not 0."""
    if isinstance(g, Const) and g.data != 0.0:
        return ZERO
    return Delta.make(None, (g,))


def _asks_partial_functions(e: Node) -> bool:
    """Returns whether conditions of an expression ask a function of variables that is not defined everywhere."""
    if not e.kinds & _PARTIAL:
        return False
    return any(n.children[0].free for n in calls_of(_PARTIAL, *(n for n in nodes_of(Compare, e) if n.free)))


def scaled_integral(body: Expr, var: Var, lo: Expr, hi: Expr) -> Expr:
    """Returns ∫ₗʰ body dx with the factors and conditions that are free of x in front; ∫ₗʰ dx is h - l.

    A condition on a function that may be no number, asin(y/r) < t, stays beside others, x² + y² < r², which may not hold there.
    """
    condition, value = nonzero_part(body)
    parts = condition.children if isinstance(condition, And) else (condition,)
    outer = [c for c in parts if var not in c.free]
    is_guarded = len(outer) < len(parts)
    if is_guarded:
        outer = [c for c in outer if not _asks_partial_functions(c)]
    if condition is not TRUE and outer:
        body = where(conjunction(*(c for c in parts if c not in outer)), value, ZERO)
    factors = body.children if isinstance(body, Mul) else (body,)
    outside = [f for f in factors if var not in f.free and not f.has_delta and not (is_guarded and _asks_partial_functions(f))]
    inside = [f for f in factors if f not in outside]
    integrand = mul(*inside)
    result = mul(*outside, sub(hi, lo) if integrand is ONE else integral_over(integrand, var, lo, hi))
    return where(conjunction(*outer), result, ZERO)
