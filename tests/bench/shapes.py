"""Shapes of programs with random parameters, each with a second program of the same value: what the error estimates are tested on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import teg
from teg import Expr
from teg.ir.expr import Param
from teg.ir.traverse import substitute

Random = np.random.Generator
Draw = Callable[[Random, int], np.ndarray]
Values = dict[str, np.ndarray]

x, y = teg.vars("x y")


@dataclass(frozen=True)
class Shape:
    """A program with parameters, the same value by another program, what to differentiate by (nothing: the value is tested), and random
    parameters: a function of a generator and how many."""

    kind: str
    name: str
    program: Expr
    again: Expr
    draw: Callable[[Random, int], Values]
    wrt: tuple[Param, ...] = ()


def uniform(low: float, high: float) -> Draw:
    return lambda rng, n: rng.uniform(low, high, n)


def normal(scale: float) -> Draw:
    return lambda rng, n: scale * rng.standard_normal(n)


def decades(low: float, high: float) -> Draw:
    """Powers of ten."""
    return lambda rng, n: 10.0 ** rng.uniform(low, high, n)


def drawing(draws: dict[str, Draw]) -> Callable[[Random, int], Values]:
    """Random values of independent parameters."""
    return lambda rng, n: {name: draw(rng, n) for name, draw in draws.items()}


# -- one variable ------------------------------------------------------------------------------------------------------

a, b, c, d, h = teg.params("a b c d h")
INTEGRANDS: dict[str, tuple[Expr, dict[str, Draw]]] = {
    "exp·cos": (teg.exp(a * x) * teg.cos(b * x), {"a": normal(2), "b": uniform(0, 30)}),
    "polynomial·sin": ((x**3 - a * x + 1) * teg.sin(b * x + a), {"a": normal(1), "b": uniform(0, 10)}),
    "1/(x² + b²)": (1 / ((x - c) ** 2 + b * b), {"b": decades(-3, 0), "c": uniform(-0.3, 2)}),
    "√x·exp": (teg.sqrt(x) * teg.exp(a * x), {"a": normal(2)}),
    "log·cos": (teg.log(x) * teg.cos(b * x), {"b": uniform(0, 10)}),
    "x^0.3·exp": (x**0.3 * teg.exp(a * x), {"a": normal(2)}),
    "√(x² + b²)": (teg.sqrt((x - c) ** 2 + b * b), {"b": decades(-3, 0), "c": uniform(-0.3, 2)}),
    "log(x² + b²)": (teg.log((x - c) ** 2 + b * b) * teg.exp(a * x), {"a": normal(1), "b": decades(-3, 0), "c": uniform(-0.3, 2)}),
    "Gaussian": (teg.exp(-(((x - c) / b) ** 2)), {"b": decades(-2, 0.3), "c": uniform(-0.3, 2)}),
    "tanh": (teg.tanh((x - c) / b), {"b": decades(-2, 0), "c": uniform(-0.3, 2)}),
    "cos x²": (teg.cos(b * x * x) / (1 + x), {"b": uniform(0, 30)}),
}
t, q0, q1, q2, u0, u1, u2, u3, k, s, w = teg.params("t q0 q1 q2 u0 u1 u2 u3 k s w")
BRACKETS: dict[str, tuple[Expr, dict[str, Draw]]] = {
    "affine": (teg.bracket(x < t), {"t": uniform(-0.2, 2)}),
    "quadratic": (teg.bracket(q0 + q1 * x + q2 * x * x > 0), {"q0": normal(0.5), "q1": normal(1), "q2": normal(1)}),
    "cubic": (teg.bracket(((u3 * x + u2) * x + u1) * x + u0 > 0), {"u0": normal(0.3), "u1": normal(1), "u2": normal(1), "u3": normal(1)}),
    "sine": (teg.bracket(teg.sin(k * x + w) > s), {"k": uniform(0.5, 12), "w": uniform(-3, 3), "s": uniform(-0.9, 0.9)}),
}
CUTS: tuple[tuple[str, ...], ...] = (
    (),
    ("affine",),
    ("quadratic",),
    ("cubic",),
    ("sine",),
    ("affine", "quadratic"),
    ("affine", "sine"),
    ("affine", "quadratic", "cubic"),
)


def _in_two_parts(f: Expr) -> tuple[Expr, Expr]:
    """∫₀ʰ f dx, and the same in two parts, the second one mirrored."""
    middle = 0.4142 * h
    right = teg.integral(substitute(f, {x: h - x}), (x, 0, h - middle))
    return teg.integral(f, (x, 0, h)), teg.integral(f, (x, 0, middle)) + right


def _of_one_variable() -> Iterator[Shape]:
    for i, (name, (f, draws)) in enumerate(INTEGRANDS.items()):
        for cut in (CUTS[i % 4], CUTS[4 + i % 4]):
            integrand, every = f, {"h": uniform(0.5, 2), **draws}
            for bracket in cut:
                integrand, every = integrand * BRACKETS[bracket][0], {**every, **BRACKETS[bracket][1]}
            yield Shape("1-D", ", ".join((name, *cut)), *_in_two_parts(integrand), drawing(every))


def _of_one_variable_moved() -> Iterator[Shape]:
    for name, cut in (("exp·cos", ("affine", "quadratic")), ("1/(x² + b²)", ("sine",)), ("√x·exp", ("affine",)), ("log(x² + b²)", ())):
        integrand, draws = INTEGRANDS[name]
        every = {"h": uniform(0.5, 2), **draws}
        for bracket in cut:
            integrand, every = integrand * BRACKETS[bracket][0], {**every, **BRACKETS[bracket][1]}
        program, again = _in_two_parts(integrand)
        yield Shape("gradient 1-D", ", ".join((name, *cut)), program, again, drawing(every), teg.params(" ".join(every)))


# -- two variables -----------------------------------------------------------------------------------------------------

NAMES = "abcdef"


def conic(i: int) -> Expr:
    """The i-th quadratic, a·x² + b·x·y + c·y² + d·x + e·y + f."""
    xx, xy, yy, of_x, of_y, one = teg.params(" ".join(f"{n}{i}c" for n in NAMES))
    return xx * x * x + xy * x * y + yy * y * y + of_x * x + of_y * y + one


def random_conic(rng: Random) -> list[float]:
    """A line, circle, ellipse or hyperbola about the unit square: six coefficients."""
    cx, cy = rng.random(2)
    sign = rng.choice([-1.0, 1.0])
    match rng.integers(0, 4):
        case 0:
            angle = 2 * np.pi * rng.random()
            xx, xy, yy, of_x, of_y = 0.0, 0.0, 0.0, np.cos(angle), np.sin(angle)
            return [xx, xy, yy, of_x, of_y, -(of_x * cx + of_y * cy)]
        case 1:
            xx, xy, yy, size = -sign, 0.0, -sign, sign * (0.1 + 0.6 * rng.random()) ** 2
        case 2:
            m = rng.standard_normal((2, 2))
            m = m @ m.T + 0.3 * np.eye(2)
            xx, xy, yy, size = -sign * m[0, 0], -2 * sign * m[0, 1], -sign * m[1, 1], sign * (0.05 + 0.3 * rng.random())
        case _:
            xx, xy, yy = rng.standard_normal(3)
            yy, size = -xx * abs(yy), 0.1 * rng.standard_normal()
    return [xx, xy, yy, -(2 * xx * cx + xy * cy), -(2 * yy * cy + xy * cx), xx * cx * cx + xy * cx * cy + yy * cy * cy + size]


def conics(count: int, draws: dict[str, Draw] | None = None) -> Callable[[Random, int], Values]:
    """Random coefficients of `count` conics, and of other parameters."""

    def drawn(rng: Random, n: int) -> Values:
        found = drawing(draws or {})(rng, n)
        for i in range(count):
            columns = np.array([random_conic(rng) for _ in range(n)]).T
            found |= {f"{name}{i}c": column for name, column in zip(NAMES, columns, strict=True)}
        return found

    return drawn


def inside(count: int) -> Expr:
    """1 where all of the conics are positive."""
    condition = conic(0) > 0
    for i in range(1, count):
        condition &= conic(i) > 0
    return teg.bracket(condition)


def _over_square(f: Expr) -> tuple[Expr, Expr]:
    return teg.integral(f, (x, 0, 1), (y, 0, 1)), teg.integral(f, (y, 0, 1), (x, 0, 1))


def _over_triangle(f: Expr) -> tuple[Expr, Expr]:
    return teg.integral(f, (x, 0, h * (1 - y)), (y, 0, 1)), teg.integral(f, (y, 0, 1 - x / h), (x, 0, h))


EXP_COS = teg.exp(x) * teg.cos(y)
LORENTZ = 1 / (b * b + (x - c) ** 2 + (y - d) ** 2)
NEAR: dict[str, Draw] = {"b": decades(-1.5, 0), "c": uniform(-0.2, 1.2), "d": uniform(-0.2, 1.2)}


def _of_two_variables() -> Iterator[Shape]:
    wave = teg.cos(a * x + b * y)
    waves: dict[str, Draw] = {"a": normal(6), "b": normal(6)}
    either = teg.bracket((conic(0) > 0) | (conic(1) > 0))
    yield Shape("2-D", "1 conic, exp·cos", *_over_square(inside(1) * EXP_COS), conics(1))
    yield Shape("2-D", "2 conics, exp·cos", *_over_square(inside(2) * EXP_COS), conics(2))
    yield Shape("2-D", "3 conics, exp·cos", *_over_square(inside(3) * EXP_COS), conics(3))
    yield Shape("2-D", "2 conics, polynomial", *_over_square(inside(2) * (1 + x * y - a * x * x)), conics(2, {"a": normal(1)}))
    yield Shape("2-D", "1 conic, 1/(r² + b²)", *_over_square(inside(1) * LORENTZ), conics(1, NEAR))
    yield Shape("2-D", "1 conic, √(r² + b²)", *_over_square(inside(1) * teg.sqrt(1 / LORENTZ)), conics(1, NEAR))
    yield Shape("2-D", "either of 2 conics, cos", *_over_square(either * wave), conics(2, waves))
    yield Shape("2-D", "no surface, 1/(r² + b²)", *_over_square(LORENTZ), drawing(NEAR))
    yield Shape("2-D", "triangle, conic, exp·cos", *_over_triangle(inside(1) * EXP_COS), conics(1, {"h": uniform(0.3, 2)}))
    yield Shape("2-D", "triangle, cos", *_over_triangle(wave), drawing({"h": uniform(0.3, 2), **waves}))


def _of_integrals() -> Iterator[Shape]:
    """Functions of inner integrals, and of whole ones."""

    inner = inside(1) * EXP_COS

    def nested(f: Callable[[Expr], Expr]) -> tuple[Expr, Expr]:
        row = teg.integral(inner, (x, 0, 1))
        split = teg.integral(inner, (x, 0, 0.4142)) + teg.integral(inner, (x, 0.4142, 1))
        mirrored = substitute(f(split), {y: 1 - y})
        return teg.integral(f(row), (y, 0, 1)), teg.integral(mirrored, (y, 0, 0.4142)) + teg.integral(mirrored, (y, 0.4142, 1))

    area, moment = _over_square(inside(1)), _over_square(inside(1) * EXP_COS)
    yield Shape("nested", "exp of a row", *nested(teg.exp), conics(1))
    yield Shape("nested", "row² · y", *nested(lambda r: r * r * y), conics(1))
    yield Shape("nested", "√(1 + row²)", *nested(lambda r: teg.sqrt(1 + r * r)), conics(1))
    yield Shape("nested", "1/(row + b)", *nested(lambda r: 1 / (r + b)), conics(1, {"b": decades(-1, 0)}))
    yield Shape("nested", "quotient", moment[0] / (area[0] + b), moment[1] / (area[1] + b), conics(1, {"b": decades(-2, 0)}))
    yield Shape("nested", "product, sin", area[0] * teg.sin(moment[0]), area[1] * teg.sin(moment[1]), conics(1))


def _of_two_variables_moved() -> Iterator[Shape]:
    def of(i: int, names: str = NAMES) -> tuple[Param, ...]:
        return teg.params(" ".join(f"{n}{i}c" for n in names))

    lines = teg.bracket((a * x + b * y < c) & (x + d * y > h))
    slopes: dict[str, Draw] = {"a": normal(1), "b": normal(1), "c": uniform(0, 1), "d": normal(1), "h": uniform(0, 1)}
    disk = teg.bracket((x - a) ** 2 + (y - b) ** 2 < c * c)
    disks: dict[str, Draw] = {"a": uniform(0, 1), "b": uniform(0, 1), "c": uniform(0.1, 0.7)}
    yield Shape("gradient 2-D", "2 lines, exp·cos", *_over_square(lines * EXP_COS), drawing(slopes), (a, b, c, d, h))
    yield Shape("gradient 2-D", "disk, exp·cos", *_over_square(disk * EXP_COS), drawing(disks), (a, b, c))
    yield Shape("gradient 2-D", "1 conic, exp·cos", *_over_square(inside(1) * EXP_COS), conics(1), of(0))
    yield Shape("gradient 2-D", "disk and conic, exp·cos", *_over_square(disk * inside(1) * EXP_COS), conics(1, disks), (a, c))


def shapes() -> list[Shape]:
    """All of them."""
    every = (_of_one_variable, _of_two_variables, _of_integrals, _of_one_variable_moved, _of_two_variables_moved)
    return [shape for family in every for shape in family()]


def systems() -> list[Shape]:
    """One to three random conics, exp(x)·cos(y)."""
    return [Shape("conics", f"{n} conics", *_over_square(inside(n) * EXP_COS), conics(n)) for n in (1, 2, 3)]
