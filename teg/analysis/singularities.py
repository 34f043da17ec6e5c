"""Where an integrand is singular, how strongly, and a velocity that carries these surfaces along.

An integrand like |x - p|^-½ or √(r² - x² - y²) is singular on a surface g = 0 that moves with the parameters. Its derivative at a fixed
point is one power worse and need not be integrable. In coordinates that move with a velocity V for which

    ġ + V·∇g = g²·T,   T finite,       V·n = 0 on each side of the domain that the surface does not carry with it

it is as integrable as the integrand itself (Reynolds' transport theorem; `teg/passes/differentiate/forward.py`). One formula holds
inside and at the sides:

    V = -Σᵢ ġᵢ·M∇gᵢ·Qᵢ / N,    Qᵢ = Π_{k≠i} g_k²,    N = Π g_k² + Σᵢ nᵢ·Qᵢ,    nᵢ = ∇gᵢᵀM∇gᵢ,    M = diag(m)

over the surfaces gᵢ of one product. For one surface it is V = -ġ·M∇g/(g² + n) and T = ġ/(g² + n). m of the variable x on (a, b) is 4(x -
a)²(b - x)²/(b - a)². The factor of a side on which a moving g vanishes identically is left out, because that side moves with g.

How strongly: the *order* of an expression at g = 0 is the exponent of its leading term. Its *roughness* is the least exponent among the
terms with non-integer powers: (0, ½) for 1 + √g, (-½, -½) for 1/√g, (0, 0) for log g. A derivative lowers the roughness by 1. Linear in
the number of nodes, for each surface.
Source: Flanders 1973; the field is new here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.extents import Extent, extent
from teg.analysis.nest import Binder, Chain
from teg.analysis.polynomial import Point, Shadow
from teg.analysis.sharp import LARGE_POWER
from teg.errors import NotDifferentiableError
from teg.ir.expr import (
    MINUS_ONE,
    ONE,
    ZERO,
    Add,
    Call,
    Compare,
    Const,
    Expr,
    Mul,
    Param,
    Pow,
    Var,
    Where,
    called,
    calls_of,
    const,
    is_infinite,
)
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder, postorder_to
from teg.ir.simplify import add, integer_power, mul, sub
from teg.ir.traverse import rewrite, substitute
from teg.numerics.field import divided

SMOOTH = math.inf
"""The roughness of an expression that has integer powers only."""
PLAIN = 0.5
"""The least roughness with a plain derivative, where g has degree 1 or 2: that of √g is 1/√g, which needs few evaluations. Beside a large
power it needs many: bounds of what may hide between nodes are poor near 1/√g."""
SINGULAR = frozenset(("sqrt", "root", "pow", "log", "asin", "acos"))
_SINGULAR, _ROOTS = called(*SINGULAR), called("sqrt", "root")
_ODD = frozenset(("sin", "tan", "asin", "atan", "sinh", "tanh", "floor", "erf", "expm1", "log1p"))
"""Functions of order 1 at 0."""
_WRAPPED = frozenset(("sqrt", "root", "pow", "magnitude"))
"""Functions that vanish, or are infinite, where their first argument vanishes."""

Order = tuple[float, float]
"""The exponent of the leading term, and the least exponent of the terms with non-integer powers."""


class Keys:
    """The identity of a surface up to a constant factor: keys are equal for expressions that are proportional by a number."""

    def __init__(self) -> None:
        self._points = (Point("first"), Point("second"))
        self._keys: dict[Expr, object] = {}

    def of(self, g: Expr) -> object:
        """Returns the key of a surface."""
        if g not in self._keys:
            u, v = (p.value(g) for p in self._points)
            self._keys[g] = divided(v, u) if u and v else g
        return self._keys[g]

    def vanishes(self, e: Expr) -> bool:
        """Returns whether an expression is 0 identically; √0 is 0."""
        if e is ZERO:
            return True
        whole = self.without_null_roots(e)
        return all(p.value(whole) == 0 for p in self._points)

    def without_null_roots(self, e: Expr) -> Expr:
        """Returns an expression with 0 for √u where u is 0 identically, and written in a longer form: 1 - a²/a²."""
        if not e.kinds & _ROOTS:
            return e
        return cast(Expr, rewrite([e], self._without_null_root)[e])

    def _without_null_root(self, old: Node, new: Node) -> Node:
        null = isinstance(new, Call) and new.name in ("sqrt", "root") and all(p.value(new.children[0]) == 0 for p in self._points)
        return ZERO if null else new


def is_singular(node: Node) -> bool:
    """Returns whether a node may be singular where one of its arguments, dependent on variables, vanishes."""
    if isinstance(node, Call):
        return node.name in SINGULAR and bool(node.children[0].free)
    return False


def sharp_nodes(roots: Iterable[Node]) -> set[Node]:
    """Returns the nodes with a singular function below them, in value position."""
    sharp: set[Node] = set()
    for node in postorder_to(roots, _SINGULAR):
        if is_singular(node) or any([c in sharp for c in node.children if not isinstance(node, Compare)]):
            sharp.add(node)
    return sharp


# -- how strongly --------------------------------------------------------------------------------------------------------


def order_at(e: Expr, is_zero: Callable[[Expr], bool]) -> Order:
    """Returns order and roughness of an expression at a surface. `is_zero` recognises the expressions proportional to the surface."""
    known: dict[Node, Order] = {}
    for node in postorder([e]):
        if isinstance(node, Expr):
            known[node] = (1.0, SMOOTH) if is_zero(node) else _order(node, known, is_zero)
    return known[e]


def _order(node: Expr, known: Mapping[Node, Order], is_zero: Callable[[Expr], bool]) -> Order:
    match node:
        case Const():
            return (math.inf, SMOOTH) if node is ZERO else (0.0, SMOOTH)
        case Add():
            parts = [known[c] for c in node.children]
            return min(p[0] for p in parts), min(p[1] for p in parts)
        case Mul():
            parts = [known[c] for c in node.children]
            total = sum(p[0] for p in parts)
            return total, min(r if r == SMOOTH else r + total - o for o, r in parts) if math.isfinite(total) else SMOOTH
        case Pow():
            return _power_order(known[node.base], float(node.exponent))
        case Where():
            a, b = known[node.then], known[node.otherwise]
            return min(a[0], b[0]), min(a[1], b[1])
        case Call():
            return _call_order(node, known, is_zero)
        case _:
            return 0.0, SMOOTH


def _power_order(base: Order, k: float) -> Order:
    order, roughness = base
    if order == 0.0 or not math.isfinite(order):
        return (0.0, roughness) if order == 0.0 else base
    if roughness == SMOOTH:
        return k * order, SMOOTH if k * order >= 0.0 and float(k * order).is_integer() else k * order
    return k * order, roughness + (k - 1.0) * order


def _call_order(node: Call, known: Mapping[Node, Order], is_zero: Callable[[Expr], bool]) -> Order:
    order, roughness = known[node.children[0]]
    match node.name:
        case "sqrt" | "root":
            return _power_order((order, roughness), 0.5)
        case "pow":
            k = node.children[1]
            if isinstance(k, Const):
                return _power_order((order, roughness), k.data)
            return (0.0, min(roughness, known[k][1])) if order == 0.0 else (-0.5, -0.5)  # an exponent that is not known
        case "log":
            return 0.0, (roughness if order == 0.0 else 0.0)
        case "magnitude":
            return order, roughness if order == 0.0 else min(roughness, order)
        case "asin" | "acos" if is_zero(sub(ONE, integer_power(node.children[0], 2))):
            return 0.0, 0.5
        case _:
            others = [known[c][1] for c in node.children[1:]]
            rough = min([roughness, *others])
            if order < 0.0:
                return 0.0, min(rough, 0.0)
            return (order if node.name in _ODD else 0.0), rough


def fades_at(e: Expr, g: Expr) -> bool:
    """Returns whether an expression tends to 0 at the surface g = 0 like a non-integer power of g: √g, g log g."""
    if not any(is_singular(n) for n in calls_of(_SINGULAR, e)):
        return False
    keys = Keys()
    return order_at(e, lambda u: _is(u, keys.of(g), keys))[0] > 0.0


# -- where ---------------------------------------------------------------------------------------------------------------


def singular_arguments(e: Expr) -> list[Expr]:
    """Returns the surfaces on which functions in value position of e may be singular: the factors of their arguments."""
    arguments: dict[Expr, None] = {}
    seen: set[Node] = set()
    stack: list[Node] = [e]
    while stack:
        node = stack.pop()
        if node in seen or not node.free or isinstance(node, Integral):
            continue
        seen.add(node)
        if isinstance(node, Call) and is_singular(node):
            argument = node.children[0]
            whole = sub(ONE, integer_power(argument, 2)) if node.name in ("asin", "acos") else argument
            arguments.update(dict.fromkeys(factors_of(whole)))
        stack.extend(node.children[1:] if isinstance(node, Where) else node.children)
    return list(arguments)


def factors_of(argument: Expr) -> list[Expr]:
    """Returns the factors whose zeros are the zeros of an argument; those of both branches for a `where`."""
    factors: list[Expr] = []
    stack: list[Expr] = [argument]
    while stack:
        node = stack.pop()
        if not node.free:
            continue
        if isinstance(node, Mul):
            stack.extend(reversed(node.children))
        elif isinstance(node, Pow):
            stack.append(node.base)
        elif isinstance(node, Call) and node.name in _WRAPPED:
            stack.append(node.children[0])
        elif isinstance(node, Where):
            stack += [node.otherwise, node.then]
        else:
            factors.append(node)
    return factors


@dataclass(frozen=True)
class Surface:
    """A surface g = 0 on which an integrand is singular, with the slopes of g and its rate of change at a fixed point (0: it stays)."""

    g: Expr
    rate: Expr
    slopes: Mapping[Var, Expr]
    roughness: float
    one_sided: bool
    """Whether g is known not to change its sign on the domain."""

    @property
    def moves(self) -> bool:
        """Returns whether g changes at a fixed point."""
        return self.rate is not ZERO


@dataclass
class Field:
    """A velocity that carries surfaces along: its components, and the rate (ġ + V·∇g)/g by the key of each surface.

    `kept` are the sides of the domain, (variable, bound), that move with the points on them.
    """

    keys: Keys
    surfaces: tuple[Surface, ...]
    velocity: dict[Var, Expr]
    rates: dict[object, Expr]
    kept: set[tuple[Var, Expr]] = field(default_factory=set)

    def rate(self, e: Expr) -> Expr | None:
        """Returns the relative rate of change of an expression that is proportional to one of the surfaces; None for others."""
        if not e.free or not isinstance(e, Add | Var | Mul | Call) or e.has_delta:
            return None
        return self.rates.get(self.keys.of(e))

    def carries(self, h: Expr) -> bool:
        """Returns whether a surface is one of those that the velocity carries along."""
        return self.keys.of(h) in self.rates


def find_surfaces(weight: Expr, chain: Chain, rate_of: Callable[[Expr], Expr], keys: Keys) -> list[Surface] | None:
    """Returns the surfaces of one integrand that must be carried along, if any of them moves: those of roughness between -1 and 1 whose
    plain derivative is not integrable, or not to all digits.

    None if a moving surface is too singular to be integrated.
    """
    plain = 1.0 if any(isinstance(n, Pow) and n.exponent > LARGE_POWER for n in postorder([weight])) else PLAIN
    variables = {b.var for b in chain}
    box = numeric_box(chain)
    surfaces: dict[object, Surface] = {}
    for g in singular_arguments(weight):
        mine = variables & g.free
        key = keys.of(g)
        if not mine or key in surfaces or (g.has_integral and any(isinstance(n, Integral) and n.free & mine for n in postorder([g]))):
            continue
        least, most = extent(g, box)
        rate = rate_of(g)
        at_side = any(keys.vanishes(_at(g, b.var, bound)) for b in chain if b.var in mine for bound in (b.lo, b.hi))
        one_sided = not least < 0.0 < most
        if least > 0.0 or most < 0.0 or (one_sided and not at_side):
            continue
        roughness = order_at(weight, lambda e, key=key: _is(e, key, keys))[1]  # type: ignore[misc]
        if roughness <= -1.0 and rate is not ZERO:
            return None
        if roughness < (plain if all(Shadow((v,)).degree(g) in (1, 2) for v in mine) else 1.0):  # the distance from others is rounded
            try:
                slopes = {v: slope(g, v) for v in sorted(mine, key=lambda v: v.name)}
                surfaces[key] = Surface(g, rate, slopes, roughness, one_sided)
            except NotDifferentiableError:
                return None
    touched = {v for s in surfaces.values() if s.moves for v in s.slopes}
    return [s for s in surfaces.values() if touched & s.slopes.keys()]


def _is(e: Expr, key: object, keys: Keys) -> bool:
    """Returns whether an expression is proportional to the surface of a key."""
    return bool(e.free) and isinstance(e, Add | Var | Mul | Call) and not e.has_delta and keys.of(e) == key


def numeric_box(chain: Chain) -> dict[Var, Extent]:
    """Returns numbers between which the variables of a nest lie."""
    box: dict[Var, Extent] = {}
    for b in chain:
        ends = [extent(bound, box) for bound in (b.lo, b.hi)]
        box[b.var] = min(e[0] for e in ends), max(e[1] for e in ends)
    return box


def _at(e: Expr, var: Var, bound: Expr) -> Expr:
    return cast(Expr, substitute(e, {var: bound})) if not is_infinite(bound) else ONE


# -- the field -----------------------------------------------------------------------------------------------------------


def field_of(surfaces: Sequence[Surface], chain: Chain, keys: Keys) -> Field:
    """Returns a velocity that carries the surfaces along."""
    velocity = Field(keys, tuple(surfaces), {}, {})
    metric = {b.var: _metric(b, chain[i + 1 :], velocity) for i, b in enumerate(chain) if any(b.var in s.slopes for s in surfaces)}
    inside = [s for s in surfaces if not _is_side(s, chain, velocity)]
    squares = [integer_power(s.g, 2) for s in inside]
    count = range(len(inside))

    def product(*without: int) -> Expr:
        return mul(*(squares[k] for k in count if k not in without))

    def along(i: int, j: int) -> Expr:
        """∇gᵢᵀM∇gⱼ"""
        a, b = inside[i].slopes, inside[j].slopes
        return add(*(mul(metric[v], a[v], b[v]) for v in a if v in b))

    whole = add(product(), *(mul(along(i, i), product(i)) for i in count))
    inverse = integer_power(whole, -1)
    speed: dict[Var, Expr] = {}  # without the factor m
    for v in metric:
        terms = [mul(s.rate, s.slopes[v], product(i)) for i, s in enumerate(inside) if v in s.slopes]
        speed[v] = mul(MINUS_ONE, add(*terms), inverse)
        velocity.velocity[v] = mul(metric[v], speed[v])
    for i, s in enumerate(inside):
        terms = [mul(s.rate, product(i))]
        for j in count:
            if j != i:
                terms.append(mul(s.rate, along(j, j), product(i, j)))
                terms.append(mul(MINUS_ONE, inside[j].rate, along(i, j), product(i, j)))
        velocity.rates[keys.of(s.g)] = mul(s.g, add(*terms), inverse)
    for s in surfaces:
        if s not in inside:  # the velocity vanishes there like m
            change = (mul(metric[v], integer_power(s.g, -1), rate, speed[v]) for v, rate in s.slopes.items())
            velocity.rates[keys.of(s.g)] = add(*change)
    return velocity


def _metric(b: Binder, inside: Chain, velocity: Field) -> Expr:
    """Returns m of one variable, which vanishes on the sides that stay. `inside` are the integrals inside the integral
    over the variable."""
    keys = velocity.keys
    factors: list[Expr] = []
    for bound in (b.lo, b.hi):
        if is_infinite(bound):
            continue
        empty = any(keys.vanishes(_at(sub(c.hi, c.lo), b.var, bound)) for c in inside)
        if empty or any(s.moves and b.var in s.slopes and keys.vanishes(_at(s.g, b.var, bound)) for s in velocity.surfaces):
            velocity.kept.add((b.var, bound))
            continue
        factors.append(_distance(b.var, bound, velocity))
    squares = [integer_power(f, 2) for f in factors]
    if is_infinite(b.lo) or is_infinite(b.hi):
        return mul(*squares, *(integer_power(add(ONE, s), -1) for s in squares))
    size = sub(b.hi, b.lo)
    if len(factors) == 2:
        return mul(const(4.0), *squares, integer_power(size, -2))
    return squares[0] if factors else ONE if size.free else integer_power(size, 2)


def _distance(var: Var, bound: Expr, velocity: Field) -> Expr:
    """Returns the distance from a side. If a fixed surface is the side, it is written with that surface: its powers cancel in the
    integrand."""
    distance = sub(var, bound)
    key = velocity.keys.of(distance)
    for s in velocity.surfaces:
        if not s.moves and velocity.keys.of(s.g) == key:
            return mul(s.g, integer_power(s.slopes[var], -1))
    return distance


def _is_side(s: Surface, chain: Chain, velocity: Field) -> bool:
    """Returns whether a fixed surface lies on a side of the domain that stays, and nowhere else."""
    if s.moves or len(s.slopes) != 1:
        return False
    (v,) = s.slopes
    (b,) = (b for b in chain if b.var is v)
    sides = [bound for bound in (b.lo, b.hi) if (v, bound) not in velocity.kept and velocity.keys.vanishes(_at(s.g, v, bound))]
    return bool(sides) and (s.one_sided or Shadow((v,)).degree(s.g) == 1)


def on_sides(surfaces: Iterable[Surface], chain: Chain) -> list[Expr]:
    """Returns the values, at the sides, of surfaces that are points of one variable and are singular there to a power of 0 or less.

    Where one of them is 0 the derivative is infinite.
    """
    values: list[Expr] = []
    for s in surfaces:
        inside = [b for b in chain if b.var in s.slopes]
        if len(inside) != 1 or s.roughness > 0.0 or not s.moves:
            continue
        for bound in (inside[0].lo, inside[0].hi):
            at = _at(s.g, inside[0].var, bound)
            if not at.free and any(isinstance(n, Param) for n in postorder([at])):
                values.append(at)
    return values
