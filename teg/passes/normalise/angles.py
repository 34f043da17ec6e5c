"""Waves of an angle, times the radius, as lines.

    r·cos(θ + s)   →   u·cos s - v·sin s         r = √(u² + v²), θ = atan2(v, u)
    r·sin(θ + s)   →   v·cos s + u·sin s
    sin(θ + s) > 0  ⇔  v·cos s + u·sin s > 0
    r < c/cos(θ + s)   ⇔   (c - u·cos s + v·sin s)·(u·cos s - v·sin s) > 0

s is anything: a parameter, or the step that turns θ into a sector, θ - p·floor(θ/p + ½). So the sides of a regular polygon are lines in
each sector, where r·cos(mod(θ, p) - p/2) has no formula for its zeros. A visit a node.
"""

from __future__ import annotations

from typing import cast

from teg.analysis.polynomial import is_null
from teg.analysis.staircase import with_floors
from teg.ir.expr import MINUS_ONE, ONE, Add, Call, Compare, Const, Expr, Mul, Pow, Where, called, calls_of
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, integer_power, mul, positive, sub, where
from teg.ir.traverse import rebuild, rewrite
from teg.passes.normalise.denominators import cleared, has_variable_denominator

Direction = tuple[Expr, Expr, Expr]
"""v, u and s of the angle atan2(v, u) + s."""


def with_lines_of_angles(root: Expr) -> Expr:
    """Returns the program without such waves. Its value is the same."""
    if not any(map(_is_angle, calls_of(called("atan2"), root))):
        return root
    order = postorder([root])
    turned = set[Node]()  # what holds an angle
    new: dict[Node, Node] = {}
    for node in order:
        result = rebuild(node, tuple([new[c] for c in node.children]))
        if _is_angle(node) or any([c in turned for c in node.children]):
            turned.add(node)
            if isinstance(result, Mul):
                result = _without_radius(result)
            elif isinstance(result, Compare) and result.resolution is None:
                result = positive(_signed(result.g), result.strict)
        new[node] = result
    return cast(Expr, new[root])


def _is_angle(n: Node) -> bool:
    return isinstance(n, Call) and n.name == "atan2" and bool(n.free)


def _without_radius(product: Mul) -> Expr:
    """Returns a product of a radius and waves of its angle, or sizes of waves, with a line in the place of the first wave."""
    for i, radius in enumerate(product.children):
        base, k = (radius.base, radius.exponent) if isinstance(radius, Pow) else (radius, 1)
        if not (isinstance(base, Call) and base.name == "sqrt" and base.free and k > 0):
            continue
        for j, factor in enumerate(product.children):
            if i != j and (line := _times_radius(factor, base)) is not None:
                return mul(integer_power(base, k - 1), line, *(f for n, f in enumerate(product.children) if n not in (i, j)))
    return product


def _times_radius(e: Expr, radius: Call) -> Expr | None:
    """Returns the product of a radius and a wave of its angle, or the size of one; None for others."""
    if isinstance(e, Where):
        then, otherwise = (_wave_times_radius(side, radius) for side in (e.then, e.otherwise))
        return None if then is None or otherwise is None else where(e.condition, then, otherwise)
    return _wave_times_radius(e, radius)


def _wave_times_radius(e: Expr, radius: Call) -> Expr | None:
    number, wave = _with_number(e)
    direction = _direction(wave)
    if direction is None:
        return None
    v, u, _ = direction
    square = add(integer_power(u, 2), integer_power(v, 2))
    if radius.children[0] is not square and not is_null(sub(radius.children[0], square)):
        return None
    return mul(number, _line(cast(Call, wave), direction))


def _signed(g: Expr) -> Expr:
    """Returns a function of the same sign, with lines in place of waves that are factors of it, or of what it is divided by."""
    if has_variable_denominator(g):
        numerator, denominator = cleared(g)
        lines = rewrite([numerator], lambda _, new: _without_radius(new) if isinstance(new, Mul) else new)[numerator]
        if lines is not numerator:
            g = mul(cast(Expr, lines), denominator)
    factors = g.children if isinstance(g, Mul) else (g,)
    signs = [f if (direction := _direction(f)) is None else _line(cast(Call, f), direction) for f in factors]
    return g if tuple(signs) == tuple(factors) else mul(*signs)


def _with_number(e: Expr) -> tuple[Expr, Expr]:
    """Returns the number in front of an expression, and the expression."""
    if isinstance(e, Mul) and len(e.children) == 2 and isinstance(e.children[0], Const):
        return e.children
    return ONE, e


def _direction(e: Node) -> Direction | None:
    """Returns the angle of a wave, turned around if it is measured clockwise; None for other expressions."""
    if not isinstance(e, Call) or e.name not in ("sin", "cos") or not e.free:
        return None
    angle: Call | None = None
    rest: list[Expr] = []
    clockwise = False
    stack = [(with_floors(e.children[0]), False)]
    while stack:
        term, negative = stack.pop()
        if isinstance(term, Add):
            stack.extend((c, negative) for c in reversed(term.children))
        elif isinstance(term, Mul) and term.children[0] is MINUS_ONE:
            stack.append((mul(*term.children[1:]), not negative))
        elif angle is None and _is_angle(term):
            angle, clockwise = cast(Call, term), negative
        else:
            rest.append(mul(MINUS_ONE, term) if negative else term)
    if angle is None:
        return None
    v, u = angle.children
    return mul(MINUS_ONE, v) if clockwise else v, u, add(*rest)


def _line(wave: Call, direction: Direction) -> Expr:
    """Returns the wave of an angle times the radius."""
    v, u, s = direction
    cosine, sine = call("cos", s), call("sin", s)
    if wave.name == "cos":
        return sub(mul(u, cosine), mul(v, sine))
    return add(mul(v, cosine), mul(u, sine))
