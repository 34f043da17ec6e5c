"""Random programs of the whole grammar, and what the generators of all kinds draw."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from tests.fuzz.syntax import (
    Program,
    Term,
    absolute,
    bracket,
    call,
    integral,
    leaves,
    maximum,
    minimum,
    parameter,
    term,
    variable,
    where,
)

x, y, z = map(variable, "xyz")
t, a, b, p, q, r = map(parameter, "tabpqr")
Values = dict[str, float | tuple[float, ...]]
Kind = Callable[[Random], Program]


def uniform(random: Random, lo: float, hi: float) -> float:
    """A number of some digits: one that a person would write, but in general position."""
    return round(random.uniform(lo, hi), random.choice((3, 4, 9)))


def decades(random: Random, lo: int, hi: int) -> float:
    """A number whose logarithm is uniform."""
    return float(f"{random.uniform(1.05, 9.9):.3g}e{random.randint(lo, hi - 1)}")


def made(kind: str, tree: Term, values: Values, scales: dict[str, float] | None = None) -> Program:
    names = leaves(tree)
    return Program(kind, tree, {k: v for k, v in values.items() if k in names}, {k: v for k, v in (scales or {}).items() if k in names})


# -- the whole grammar ----------------------------------------------------------------------------------------------------


def smooth(random: Random, variables: tuple[Term, ...], parameters: tuple[Term, ...], depth: int) -> Term:
    """A function that is finite on the unit box."""
    if depth == 0:
        return random.choice((*variables, *variables, *parameters, term(uniform(random, -2, 2))))
    u = smooth(random, variables, parameters, depth - 1)
    v = smooth(random, variables, parameters, depth - 1)
    return random.choice(
        (
            lambda: u + v,
            lambda: u - v,
            lambda: u * v,
            lambda: u * uniform(random, -3, 3),
            lambda: u ** random.choice((2, 2, 3)),
            lambda: call("sin", u),
            lambda: call("cos", u * 2),
            lambda: call("exp", u * 0.5),
            lambda: call("tanh", u),
            lambda: call("atan", u),
            lambda: u / (v * v + 1),
            lambda: call("sqrt", u * u + 1.5),
            lambda: call("log", u * u + 0.7),
            lambda: call("sinh", call("sin", u)),
            lambda: call("cosh", call("cos", u)),
            lambda: call("asin", call("tanh", u) * 0.8),
            lambda: call("acos", call("sin", u) * 0.9),
            lambda: call("atan2", u, v * v + 0.5),
        )
    )()


def level(random: Random, variables: tuple[Term, ...], parameters: tuple[Term, ...]) -> Term:
    """The two sides' difference of a condition that holds on a part of the unit box."""
    if random.random() < 0.45:
        g: Term = term(0) + parameters[0] * random.choice((1, 1, -1, 2)) - variables[0] * uniform(random, 0.3, 2)
        for v in variables[1:]:
            g = g + v * random.choice((term(uniform(random, -1.5, 1.5)), parameters[-1]))
        return g
    u = smooth(random, variables, parameters, random.choice((1, 2)))
    return u + variables[0] * uniform(random, 0.4, 1.5) - parameters[0] - uniform(random, 0, 0.4)


def condition(random: Random, variables: tuple[Term, ...], parameters: tuple[Term, ...], depth: int) -> Term:
    kind = random.random()
    if depth == 0 or kind < 0.4:
        g = level(random, variables, parameters)
        return random.choice((lambda: g > 0, lambda: g < 0, lambda: term(0) <= g, lambda: g >= 0))()
    u = condition(random, variables, parameters, depth - 1)
    if kind < 0.55:
        return ~u
    v = condition(random, variables, parameters, depth - 1)
    return u & v if kind < 0.8 else u | v


def anything(random: Random, variables: tuple[Term, ...], parameters: tuple[Term, ...], depth: int) -> Term:
    """A function that may jump and have kinks."""
    if depth == 0 or random.random() < 0.15:
        return smooth(random, variables, parameters, random.choice((1, 1, 2)))
    u = anything(random, variables, parameters, depth - 1)
    v = anything(random, variables, parameters, depth - 1)
    c = condition(random, variables, parameters, 1)
    return random.choice(
        (
            lambda: bracket(c) * u,
            lambda: bracket(c) + u,
            lambda: where(c, u, v),
            lambda: where(c, u, 0.0),
            lambda: where(c, u, v) ** 2,
            lambda: minimum(u, v),
            lambda: maximum(u, v),
            lambda: absolute(u),
            lambda: absolute(u - v) * bracket(c),
            lambda: call("sin", u + bracket(c)),
            lambda: call("exp", call("sin", u)) * bracket(c),
            lambda: call("floor", level(random, variables, parameters) * 2) + u,
            lambda: call("mod", level(random, variables, parameters) * 1.5, 1.0) * u,
            lambda: u + v,
            lambda: u * v,
        )
    )()


def parameter_values(random: Random) -> Values:
    return {n: uniform(random, 0.15, 0.95) * random.choice((1, 1, -1)) for n in "tabpqr"}


def box(random: Random, names: str) -> list[tuple[str, Term | float, Term | float]]:
    lo = random.choice((0.0, 0.0, -1.0, -0.5))
    return [(n, lo, random.choice((1.0, 1.0, 1.5))) for n in names]


def grammar_in_one(random: Random) -> Program:
    body = anything(random, (x,), (t, a), random.choice((1, 2)))
    domain = box(random, "x")
    if random.random() < 0.2:
        domain = [("x", random.choice((term(0), -1 * b)), random.choice((p, b * b + 0.3, term(1))))]
    return made("grammar, one variable", integral(body, *domain), parameter_values(random))


def grammar_in_two(random: Random) -> Program:
    body = anything(random, (x, y), (t, a), 1)
    domain = box(random, "xy")
    if random.random() < 0.2:
        domain[0] = ("x", 0.0, random.choice((y, y * y + 0.2, p + 0.3 * y, call("exp", -1 * y))))
    return made("grammar, two variables", integral(body, *domain), parameter_values(random))


def outside(random: Random) -> Program:
    """Functions of integrals, and conditions on them."""
    first = integral(bracket(level(random, (x,), (t, a)) > 0) * smooth(random, (x,), (a,), 1), ("x", 0, 1))
    second = integral(where(level(random, (y,), (b, p)) > 0, smooth(random, (y,), (p,), 1), 0.5), ("y", -1, 1))
    tree = random.choice(
        (
            lambda: first * second,
            lambda: first / (second * second + 1),
            lambda: call("exp", first) + call("sin", second),
            lambda: where(first < second, first * second, second),
            lambda: maximum(first, second),
            lambda: absolute(first - second * 0.5) ** 1,
            lambda: call("sqrt", first * first + second * second + 0.1),
        )
    )()
    return made("functions of integrals", tree, parameter_values(random))


def nested(random: Random) -> Program:
    """Integrals of functions of integrals."""
    kind = random.randrange(6)
    if kind == 0:
        inner = integral(bracket(y < x * a + t * 0.5), ("y", 0, 1))
        tree = integral(random.choice((call("exp", inner), inner**2, inner * bracket(x < t), call("sin", 3 * inner))), ("x", 0, 1))
    elif kind == 1:
        tree = integral(absolute(integral(1 - y / p, ("y", 0, x))), ("x", 0, 1))
    elif kind == 2:
        inner = integral(bracket(y * y < x + t * 0.4) * call("exp", a * y), ("y", -1, 1))
        tree = integral(bracket(inner > p) * x, ("x", 0, 1))
    elif kind == 3:
        inner = integral(smooth(random, (x, y), (a,), 1), ("y", 0, x))
        tree = integral(maximum(inner, t * 0.3), ("x", 0, 1))
    elif kind == 4:
        tree = integral(x * bracket(x < t), ("x", 0, integral(bracket(y < a) + 0.3, ("y", 0, 1))))
    else:
        inner = integral(bracket(x + y < t) * (1 + y), ("y", 0, x * x + 0.2))
        tree = integral(call("exp", -1 * inner) * where(x > a, x, 1 - x), ("x", 0, 1))
    values = {n: uniform(random, 0.2, 0.9) for n in "tabpqr"}
    return made("nested integrals", tree, values)
