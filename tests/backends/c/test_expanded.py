"""Integrals of polynomials from moments: as sums over nodes, and shorter."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest

from teg.backends.c.crossing import Writer
from teg.backends.c.expanded import Poly, box_moments, integrals
from teg.program import Arg, Assign, Program
from teg.program.interpreter import interpret

VARIABLES: dict[str, Poly] = {
    "x0": {(0, 0): "p0", (1, 0): "p1", (0, 1): "p2"},
    "x1": {(0, 0): 0.5, (1, 0): 0.5},
    "x2": {(0, 0): "p3", (0, 1): -0.25},
}
BODIES: dict[str, tuple[list[Assign], list[Arg], int]] = {
    "linear": ([Assign("v0", "add", ("x0", "x1", 2.0)), Assign("v1", "sub", ("v0", "x2"))], ["v1", "x0", 3.0], 1),
    "products": (
        [
            Assign("v0", "mul", ("x0", "x1")),
            Assign("v1", "mul", (3.0, "v0", "p4")),
            Assign("v2", "neg", ("v1",)),
            Assign("v3", "powi", ("x2", 2)),
            Assign("v4", "div", ("v3", "p4")),
            Assign("v5", "sub", ("v4", "v2")),
        ],
        ["v5", "v3", "v0"],
        2,
    ),
    "multiples": (
        [
            Assign("v0", "mul", ("p3", "x0")),
            Assign("v1", "mul", (2.0, "v0")),
            Assign("v2", "mul", ("v1", "x1")),
            Assign("v3", "powi", ("v1", 2)),
            Assign("v4", "mul", ("x0", "x0")),
            Assign("v5", "mul", ("p4", "v0", "v1")),
        ],
        ["v2", "v3", "v4", "v5"],
        2,
    ),
    "a steady part": ([Assign("v0", "mul", ("p3", "p4")), Assign("v1", "mul", ("v0", "x0", "x0", "x1", "x2"))], ["v1"], 4),
    "sums multiplied": (
        [
            Assign("v0", "sub", ("x0", "x1")),
            Assign("v1", "powi", ("v0", 2)),
            Assign("v2", "add", ("v1", "x2")),
            Assign("v3", "mul", ("v2", "v0")),
        ],
        ["v3", "v2"],
        3,
    ),
}
GIVEN = [0.7, -1.3, 0.4, 1.9, 0.6]


def by_nodes(body: list[Assign], values: list[Arg]) -> list[float]:
    """The means over [-1, 1]², by the interpreter at nodes."""
    at, weights = np.polynomial.legendre.leggauss(6)
    total = np.zeros(len(values))
    for i, a in enumerate(at):
        for j, b in enumerate(at):
            products = [
                Assign(f"v9{n[1:]}{k}", "mul", (c, a ** m[0] * b ** m[1]))
                for n, p in VARIABLES.items()
                for k, (m, c) in enumerate(p.items())
            ]
            coordinates = [Assign(n, "add", tuple(f"v9{n[1:]}{k}" for k in range(len(p)))) for n, p in VARIABLES.items()]
            program = Program(tuple("abcde"), (*products, *coordinates, *body), tuple(values))
            total += weights[i] * weights[j] / 4.0 * np.array(interpret(program, GIVEN).outputs)
    return list(total)


@pytest.mark.parametrize("name", BODIES)
def test_as_nodes(name: str) -> None:
    body, values, degree = BODIES[name]
    w = Writer(count(1000))
    found = integrals(w, body, values, VARIABLES, box_moments(degree))
    assert found is not None
    outputs = tuple(found[v] for v in values)
    ours = interpret(Program(tuple("abcde"), tuple(w.lines), outputs), GIVEN).outputs
    assert ours == pytest.approx(by_nodes(body, values), rel=1e-14, abs=1e-15)


def test_products_of_one_factor_share_its_moments() -> None:
    """∫ p·q for three q: three moments of p, and three terms each."""
    body = [Assign(f"v{k}", "mul", ("x0", n)) for k, n in enumerate(("x0", "x1", "x2"))]
    w = Writer(count(1000))
    moments: dict[tuple[int, int], Arg] = {(p, q): f"p{10 + 3 * p + q}" for p in range(3) for q in range(3 - p)}
    assert integrals(w, body, ["v0", "v1", "v2"], VARIABLES, moments) is not None
    assert sum(s.op == "mul" for s in w.lines) <= 3 * 3 + 3 + 2 + 2


@pytest.mark.parametrize("op", ["exp", "abs"])
def test_what_is_no_polynomial_has_no_integrals(op: str) -> None:
    body = [Assign("v0", op, ("x0",))]
    assert integrals(Writer(count(1000)), body, ["v0"], VARIABLES, box_moments(2)) is None
    assert integrals(Writer(count(1000)), [*body, Assign("v1", "mul", ("x0", "x1"))], ["v1"], VARIABLES, box_moments(2)) is not None
