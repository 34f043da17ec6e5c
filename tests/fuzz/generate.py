"""Random programs, by kind. A seed is a program, on every machine."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from random import Random

from tests.fuzz.grammar import (
    Kind,
    Values,
    a,
    b,
    decades,
    grammar_in_one,
    grammar_in_two,
    level,
    made,
    nested,
    outside,
    p,
    parameter_values,
    q,
    r,
    t,
    uniform,
    x,
    y,
    z,
)
from tests.fuzz.laws import LAWS
from tests.fuzz.syntax import (
    AGAIN,
    MONOTONE,
    Program,
    Term,
    absolute,
    bracket,
    call,
    entry,
    integral,
    maximum,
    minimum,
    parameter,
    term,
    total,
    where,
)

# -- surfaces ---------------------------------------------------------------------------------------------------------------


def closed_curve(random: Random) -> Program:
    """Curves of size s in a box of about that size, s from 1e-6 to 1e6."""
    s = decades(random, -6, 6) if random.random() < 0.75 else 1.0
    n = random.choice((2, 2, 4, 4, 6, 8, 12))
    size = uniform(random, 0.3, 0.8)
    c = uniform(random, -0.3, 0.3)
    u, v = x - p, y
    values: Values = {"t": size * s, "p": c * s, "a": uniform(random, 0.5, 1.5), "b": uniform(random, 0.1, 0.24)}
    scales = {"t": size * s, "p": s, "a": 1.0, "b": 0.1}
    w = (1 / s) * x
    weight = random.choice((term(1), term(1), 1 + w, call("exp", w), where(x > 0.05 * s, 1.0, 2.0)))
    kind = random.randrange(9)
    if kind == 0:
        c1 = u**n + v**n < t**n
    elif kind == 1:
        c1 = u * u + a * v * v < t * t
    elif kind == 2:
        c1 = absolute(u) ** n + absolute(v) ** n < t**n
    elif kind == 3:
        d = (1 / s) ** 2
        q2 = d * (x * x + y * y)
        c1 = (q2 + b) ** 2 < q2
    elif kind == 4:
        c1 = (x * x + y * y - t * x) ** 2 < t * t * (x * x + y * y)
        values["t"] = uniform(random, 0.15, 0.4) * s
    elif kind == 5:
        c1 = u * u + v * v + a * u * v < t * t
    elif kind == 6:
        c1 = maximum(absolute(u), absolute(v)) + 0.3 * absolute(u) < t
    elif kind == 7:
        c1 = (call("sqrt", x * x + y * y) - t) ** 2 < (0.3 * t) ** 2 * b
    else:
        e = 0.81 * s**2
        c1 = (x * x + y * y) ** 2 < 2 * e * a * 0.1 * (x * x - y * y) + (t * t * t * t) * 0.5
    return made(
        "closed curves at scales", integral(bracket(c1) * weight, ("x", -1.1 * s, 1.2 * s), ("y", -1.3 * s, 1.15 * s)), values, scales
    )


def boolean(random: Random) -> Program:
    """Unions and intersections of disks, half-planes and graphs."""

    def one(k: int) -> Term:
        name = parameter("tabpqr"[k])
        kind = random.randrange(4)
        if kind == 0:
            cx, cy = uniform(random, 0.1, 0.9), uniform(random, 0.1, 0.9)
            return (x - cx) ** 2 + (y - cy) ** 2 < name**2
        if kind == 1:
            return x * uniform(random, -1, 1) + y < name
        if kind == 2:
            return y < name * call(random.choice(("sin", "exp", "cos")), x * uniform(random, 1, 3)) * 0.5 + 0.2
        return x * y > name * 0.4

    c = one(0)
    for k in range(1, random.choice((2, 2, 3))):
        other = one(k)
        c = random.choice((c & other, c | other, c & ~other))
    values = {n: uniform(random, 0.2, 0.6) for n in "tabpqr"}
    weight = random.choice((term(1), 1 + x, call("exp", x * a)))
    return made("unions and intersections", integral(bracket(c) * weight, ("x", 0, 1), ("y", 0, 1)), values)


def three(random: Random) -> Program:
    """Three variables."""
    kind = random.randrange(5)
    if kind == 0:
        c = x + a * y + z < t + 0.6
    elif kind == 1:
        c = x * x + y * y + z * z < t * t
    elif kind == 2:
        c = (x + y < t + 0.2) & (z < a)
    elif kind == 3:
        c = x * y + z * a < t
    else:
        c = (x < t) & (y * z < a * 0.3)
    weight = random.choice((term(1), 1 + z, x * y))
    values = {n: uniform(random, 0.25, 0.8) for n in "tabpqr"}
    return made("three variables", integral(bracket(c) * weight, ("x", 0, 1), ("y", 0, 1), ("z", 0, 1)), values)


# -- the same in other words ---------------------------------------------------------------------------------------------


def disguise(random: Random, u: Term, v: Term, lo: float, hi: float) -> Term:
    """u < v, written through an increasing function that is defined where both are."""
    fitting = [name for name, (_, least, most) in MONOTONE.items() if least <= lo and hi <= most]
    return Term("disguised", (u, v), random.choice(fitting))


def other_words(random: Random) -> Program:
    """The same condition twice, in other words."""
    kind = random.randrange(6)
    if kind < 3:
        u, v, lo, hi = x, t, 0.0 + 1e-9, 1.0
        domain: list[tuple[str, Term | float, Term | float]] = [("x", 0.0, 1.0)]
        if random.random() < 0.3:
            lo, domain = -2.0, [("x", -2.0, 2.0)]
            hi = 2.0
        weight = random.choice((term(1), 1 + x, call("exp", a * x)))
    elif kind == 3:
        u, v, lo, hi = x + a * y, t + 0.2, 1e-9, 3.0
        domain = [("x", 0.0, 1.0), ("y", 0.0, 1.0)]
        weight = random.choice((term(1), 1 + x))
    elif kind == 4:
        u, v, lo, hi = x * x + y * y, t * t, 1e-9, 3.0
        domain = [("x", -1.0, 1.0), ("y", -1.0, 1.0)]
        weight = random.choice((term(1), 1 + x))
    else:
        u, v, lo, hi = y, t * x, 1e-9, 1.0
        domain = [("x", 0.0, 1.0), ("y", 0.0, 1.0)]
        weight = random.choice((term(1), 1 + y))
    first = random.choice((u < v, disguise(random, u, v, lo, hi)))
    second = disguise(random, u, v, lo, hi)
    joined = random.choice(
        (
            lambda: bracket(first) * bracket(second),
            lambda: bracket(first & second),
            lambda: bracket(first | second),
            lambda: (bracket(first) - bracket(second)) ** 2,
            lambda: bracket(first) * bracket(~second),
            lambda: bracket(first) + bracket(first) * bracket(second),
            lambda: where(first, bracket(second), 0.5),
            lambda: bracket(second),
            lambda: bracket(first) * bracket(second) * bracket(disguise(random, u, v, lo, hi)),
        )
    )()
    values: Values = {"t": uniform(random, 0.25, 0.85), "a": uniform(random, 0.3, 0.8)}
    if kind < 3 and domain[0][1] == -2.0 and random.random() < 0.5:
        values["t"] = -float(values["t"])  # type: ignore[arg-type]
    return made("the same in other words", integral(joined * weight, *domain), values)


def rewritten_values(random: Random) -> Program:
    """A condition in which an equal value is written in other words."""
    base = random.choice((grammar_in_one, boolean, far))(random)
    nodes = [n.data for n in _walk(base.tree) if n.op == "parameter"]
    if not nodes:
        return base
    name = random.choice(nodes)
    form = random.choice(AGAIN if not base.far else ("plus nothing", "twice a half", "neg of neg"))
    tree = _replaced(
        base.tree, lambda n: Term("again", (n,), form) if n.op == "parameter" and n.data == name and random.random() < 0.6 else None
    )
    return replace(base, kind="values in other words", tree=tree)


def _walk(tree: Term) -> list[Term]:
    found = [tree]
    for part in tree.parts:
        found += _walk(part)
    return found


def _replaced(tree: Term, change: Callable[[Term], Term | None]) -> Term:
    new = change(tree)
    return new if new is not None else replace(tree, parts=tuple(_replaced(part, change) for part in tree.parts))


# -- features, scales, singularities ----------------------------------------------------------------------------------------


def peak(random: Random, u: Term, c: Term | float, k: Term | float) -> Term:
    """A feature of width 1/k at u = c."""
    s = k * (u - c)
    return random.choice(
        (
            lambda: 1 / call("cosh", s) ** 2,
            lambda: 1 / (1 + s * s),
            lambda: call("exp", -1 * absolute(s)),
            lambda: 1 - call("tanh", s) ** 2,
            lambda: call("exp", -1 * (s * s)),
            lambda: call("exp", -1 * s**4),
            lambda: 1 + call("exp", -1 * absolute(s)),
            lambda: call("tanh", s),
            lambda: call("atan", s),
            lambda: 1 / call("sqrt", 1 + s * s),
            lambda: 1 / (1 + s * s) ** 2,
        )
    )()


def narrow(random: Random) -> Program:
    """Smooth integrands with a narrow feature, at an end or inside."""
    k = decades(random, 2, 4) if random.random() < 0.8 else decades(random, 4, 5)
    c = uniform(random, 0.1, 0.9)
    kind = random.randrange(7)
    if kind == 0:
        f = random.choice(
            (
                call("exp", -k * x),
                call("exp", -k * (1 - x)) * k,
                (1 + x) ** (-min(k, 3000)),
                x ** int(min(k, 4000)),
                1 / (1 + k * x) ** 2,
                call("exp", -k * x) * call("sin", x),
                2 - call("tanh", k * x),
            )
        )
        tree = integral(f * random.choice((term(1), 1 + x, call("exp", a * x))), ("x", 0, 1))
    elif kind < 4:
        place: Term | float = random.choice((p, c))
        tree = integral(peak(random, x, place, k) * random.choice((term(1), 1 + a * x, bracket(x > t))), ("x", 0, 1))
    elif kind == 4:
        tree = integral(bracket(y < call("exp", -k * x)), ("y", 0, 1), ("x", 0, 1))
    elif kind == 5:
        tree = integral(peak(random, x, p, k) * random.choice((y, bracket(y < t), call("exp", y * a))), ("x", 0, 1), ("y", 0, 1))
    else:
        tree = integral(bracket(y < peak(random, x, p, k) * 0.7), ("y", 0, 1), ("x", 0, 1))
    values: Values = {"p": c, "t": uniform(random, 0.2, 0.8), "a": uniform(random, 0.3, 0.9)}
    return made("narrow features", tree, values, {"p": 1 / k})


def approaching(random: Random) -> Program:
    """Surfaces that come close to each other, or to a side."""
    k = uniform(random, 5, 120)
    f = random.choice(
        (call("exp", -k * x * t), 1 / (1 + k * x * t) ** 4, (1 - x) ** 8 * t, t * call("exp", -k * x) + 1e-3 * a, (1 - x * t) ** 6)
    )
    c = random.choice((absolute(y) < f, (y < f) & (y > -1 * f), (y < f) & (y > 0.5 * f), y * y < f * f))
    return made("approaching surfaces", integral(bracket(c), ("y", -1, 1), ("x", 0, 1)), {"t": uniform(random, 0.6, 1.2), "a": 0.7})


def literals(random: Random) -> Program:
    """Coefficients from 1e-30 to 1e30 as literals."""
    e = float(f"{random.uniform(1, 9.9):.3g}e-{random.randint(5, 30)}")
    kind = random.randrange(7)
    if kind == 0:
        tree = integral(bracket(x * x + e * y < t), ("x", 0, 1), ("y", 0, 1))
    elif kind == 1:
        tree = integral(bracket(x + e * y < t), ("x", 0, 1), ("y", 0, 1))
    elif kind == 2:
        tree = integral(bracket(e * x + y < t) * (1 + x), ("x", 0, 1), ("y", 0, 1))
    elif kind == 3:
        tree = integral(bracket(x * y * e + x < t), ("x", 0, 1), ("y", 0, 1))
    elif kind == 4:
        tree = integral(bracket(x * x + e * x < t * 0.7) * call("exp", a * x), ("x", -1, 1))
    elif kind == 5:
        big = 1 / e
        tree = integral(bracket(big * x < big * t), ("x", 0, 1)) + integral(bracket(big * x + y < big * a), ("x", 0, 1), ("y", 0, 1))
    else:
        tree = integral(bracket(e * (x * x + y * y) < e * t) * call("exp", x), ("x", -1, 1), ("y", -1, 1))
    return made("tiny and huge literals", tree, {"t": uniform(random, 0.1, 0.6), "a": uniform(random, 0.2, 0.8)})


def singular(random: Random) -> Program:
    """Singularities that can be integrated, and move."""
    e = random.choice((0.5, 0.5, 0.25, 0.3, 0.7))
    gap = x - t
    kind = random.randrange(10)
    w = random.choice((term(1), 1 + x, call("exp", a * x)))
    body = (
        lambda: w / call("sqrt", absolute(gap)),
        lambda: w * absolute(gap) ** (-e),
        lambda: w * call("log", absolute(gap)),
        lambda: where(gap > 0, w / call("sqrt", gap), 0.0),
        lambda: where(gap > 0, w * gap ** (-e), a),
        lambda: w * absolute(gap) ** e,
        lambda: where(gap > 0, w * call("sqrt", gap), 0.0),
        lambda: where(x * x < t * t, call("sqrt", t * t - x * x), 0.0),
    )
    if kind < 8:
        tree = integral(body[kind](), ("x", 0, 1))
    elif kind == 8:
        tree = integral(w / call("sqrt", gap), ("x", t, 1))
    else:
        tree = integral(where(x * x + y * y < t * t, call("sqrt", t * t - x * x - y * y), 0.0), ("x", -1, 1), ("y", -1, 1))
    return made("moving singularities", tree, {"t": uniform(random, 0.2, 0.8), "a": uniform(random, 0.3, 0.9)})


def far(random: Random) -> Program:
    """A pixel and a triangle, written far from the origin, with edges as determinants; the reference has them at the origin."""
    names = [(t, a), (b, p), (q, r)]
    ranges = (((0.0, 0.4), (0.0, 0.4)), ((0.6, 1.0), (0.0, 0.5)), ((0.2, 0.8), (0.6, 1.0)))
    values: Values = {}
    for pair, bounds in zip(names, ranges, strict=True):
        for name, (lo, hi) in zip(pair, bounds, strict=True):
            values[name.data] = round(random.uniform(lo, hi) * 2**16) / 2**16  # a shift keeps all digits
    edges = []
    expanded = random.random() < 0.5
    for k in range(3):
        (x0, y0), (x1, y1) = names[k], names[(k + 1) % 3]
        if expanded:
            edges.append(x0 * y1 - x1 * y0 + (y0 - y1) * x + (x1 - x0) * y > 0)
        else:
            edges.append((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0)
    weight = random.choice((term(1), x - t + 1, (y - a) * (x - b)))
    tree = integral(bracket(edges[0] & edges[1] & edges[2]) * weight, ("x", 0.0, 1.0), ("y", 0.0, 1.0))
    return replace(made("far coordinates", tree, values, dict.fromkeys("tabpqr", 1.0)), far=float(random.choice((0, 16, 256, 4096, 65536))))


def sums(random: Random) -> Program:
    """Sums over arrays, each term compared with all, itself among them."""
    n = random.choice((2, 3, 4))
    zs = tuple(uniform(random, 0.1, 0.9) for _ in range(n))
    ws = tuple(uniform(random, 0.2, 0.8) for _ in range(n))
    zk, zj = entry("Z", "k"), entry("Z", "j")
    wk, wj = entry("W", "k"), entry("W", "j")
    kind = random.randrange(6)
    if kind == 0:
        hidden = total(bracket((x < wj) & (zj < zk)), "j", n)
        body = bracket((x < wk) & (hidden < 0.5)) * (1 + wk)
    elif kind == 1:
        hidden = total(bracket((x < wj) & (zj + x * wj < zk + x * wk)), "j", n)
        body = bracket(hidden < 0.5) * bracket(x < wk) * zk
    elif kind == 2:
        hidden = total(bracket(zj * x < zk * x + wj * (x - x * 1)), "j", n)
        body = bracket(hidden < 1.5) * call("exp", zk * x)
    elif kind == 3:
        body = total(bracket(wj + zj * x <= wk + zk * x), "j", n) ** 2 * 0.25
    elif kind == 4:
        body = maximum(bracket(x < wk), bracket(x < zk)) * call("exp", -1 * t * x)
    else:
        body = call("mod", wk + 2 * zk * x, 1.0) * bracket(x < zk)
    inside = random.random() < 0.5
    tree = integral(total(body, "k", n), ("x", 0, 1)) if inside else total(integral(body, ("x", 0, 1)), "k", n)
    return made("sums with self-comparison", tree, {"Z": zs, "W": ws, "t": 0.4}, {"Z": 0.5, "W": 0.5})


def many_roots(random: Random) -> Program:
    """Conditions with many roots, and with nearly double ones."""
    kind = random.randrange(7)
    values: Values = {"t": uniform(random, 0.1, 0.9), "a": uniform(random, 0.2, 0.8)}
    if kind == 0:
        k = uniform(random, 10, 120)
        tree = integral(bracket(call("sin", k * x) < t) * (1 + x), ("x", 0, 1))
    elif kind == 1:
        k = uniform(random, 5, 30)
        tree = integral(bracket(call("sin", k * x) + x * a < t), ("x", 0, 1))
    elif kind == 2:
        roots = sorted(uniform(random, -0.95, 0.95) for _ in range(random.choice((3, 5, 8, 12))))
        g: Term = x - t * 0.9
        for root in roots:
            g = g * (x - root)
        tree = integral(bracket(g > 0) * call("exp", x), ("x", -1, 1))
    elif kind == 3:
        e = decades(random, -9, -3)
        tree = integral(bracket((x * x + 0.5) ** 2 < x * x + 0.25 + a * e), ("x", -1, 1))
        return made("many and double roots", tree, values, {"a": 0.3})
    elif kind == 4:
        tree = integral(bracket((t * x) ** 2 - 2 * t * x + 1 > 0) * (1 + a * x), ("x", 0, 2))
    elif kind == 5:
        n = random.choice((5, 7, 9))
        tree = integral(bracket(x**n - x + 0.2 * a < t * 0.3), ("x", -1.2, 1.2))
    else:
        tree = integral(bracket(call("floor", 6 * x + t) * a < call("mod", x * 3.3, 1.0) + 1), ("x", 0, 1))
    return made("many and double roots", tree, values)


def steps(random: Random) -> Program:
    """floor, mod, round, ceil, sign-like functions, min and max inside each other."""
    u = level(random, (x,), (t, a)) * uniform(random, 1.5, 4)
    name = random.choice(("floor", "ceil", "round"))
    kind = random.randrange(6)
    if kind == 0:
        body = call(name, u) * x
    elif kind == 1:
        body = bracket(call("mod", u, 1.0) < 0.3 + 0.2 * a) * (1 + x)
    elif kind == 2:
        body = call("exp", call(name, u) * 0.2) * bracket(x < t)
    elif kind == 3:
        body = call("mod", call("floor", u) * 1.5, 2.0) + x
    elif kind == 4:
        body = minimum(call("floor", u), maximum(x, t))
    else:
        body = bracket(call("mod", call("floor", u), 2.0) < 0.5) * call("exp", a * x)
    return made("floor and mod", integral(body, ("x", 0, 1)), parameter_values(random))


KINDS: dict[str, tuple[Kind, int]] = {
    "grammar_in_one": (grammar_in_one, 20),
    "grammar_in_two": (grammar_in_two, 8),
    "outside": (outside, 6),
    "nested": (nested, 6),
    "closed_curve": (closed_curve, 9),
    "boolean": (boolean, 4),
    "three": (three, 2),
    "other_words": (other_words, 12),
    "rewritten_values": (rewritten_values, 5),
    "narrow": (narrow, 10),
    "approaching": (approaching, 3),
    "literals": (literals, 6),
    "singular": (singular, 7),
    "far": (far, 3),
    "sums": (sums, 5),
    "many_roots": (many_roots, 6),
    "steps": (steps, 5),
}
"""Every kind and its weight."""


def program(seed: int) -> Program:
    """The program of a seed."""
    random = Random(seed * 7919 + 13)
    kinds = list(KINDS.values())
    for _ in range(20):
        (kind,) = random.choices([k for k, _ in kinds], [w for _, w in kinds])
        made_one = kind(random)
        if any(n.op == "integral" for n in _walk(made_one.tree)) and all(math.isfinite(v) for v in _numbers(made_one)):
            by_law = not made_one.far and (kind is three or random.random() < 0.25)
            return replace(made_one, seed=seed, law=random.choice(sorted(LAWS)) if by_law else "")
    raise AssertionError(seed)


def _numbers(made_one: Program) -> list[float]:
    found: list[float] = []
    for value in made_one.values.values():
        found += value if isinstance(value, tuple) else (value,)
    return found
