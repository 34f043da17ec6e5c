"""Programs of floor, mod, round and ceil with exact values and derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import teg

B, INT = teg.bracket, teg.integral
x, y, z = teg.vars("x y z")
t, a, b, c, m, s = teg.params("t a b c m s")
SQUARE = ((x, 0, 1), (y, 0, 1))


def board(u: teg.Expr, v: teg.Expr, even: object, odd: object) -> teg.Expr:
    """A checkerboard in the coordinates u and v."""
    return teg.where(teg.mod(teg.floor(u) + teg.floor(v), 2) < 1, even, odd)


Formula = tuple[teg.Expr, Callable[..., Any]]
"""A program and the same in NumPy."""


@dataclass(frozen=True)
class Problem:
    """A program, and what value, gradient and Hessian are. From the crossings by hand, or the moments of the clipped cells (polygons), and
    derivatives of these formulas, in mpmath with 60 digits at exactly these float64 parameters."""

    build: Callable[[], teg.Expr]
    params: dict[str, float]
    value: str
    grad: dict[str, str]
    hess: dict[tuple[str, str], str]


PROBLEMS = {
    "floor-of-a-product": Problem(
        lambda: INT(teg.floor(x * t), (x, 0, 3)),
        {"t": 1.7},
        "6.1764705882352938872",
        {"t": "5.1903114186851213784"},
        {("t", "t"): "-6.10624872786484884"},
    ),
    "remainder-by-a-parameter": Problem(
        lambda: INT(teg.mod(x, t), (x, 0, 1)),
        {"t": 0.3},
        "0.13999999999999999334",
        {"t": "0.59999999999999986677"},
        {("t", "t"): "12.0"},
    ),
    "floor-times-exp": Problem(
        lambda: INT(teg.exp(x) * teg.floor(4 * x + t), (x, 0, 1)),
        {"t": 0.3},
        "3.6663894412324489311",
        {"t": "1.8016844681509330026"},
        {("t", "t"): "-0.45042111703773325065"},
    ),
    "sine-of-a-floor": Problem(
        lambda: INT(teg.sin(a * teg.floor(5 * x + t) + x), (x, 0, 1)),
        {"t": 0.3, "a": 0.7},
        "0.28786524042137698207",
        {"t": "-0.1616346715672446753", "a": "-1.3132924134931361777"},
        {("t", "t"): "0.036917222360376117639", ("t", "a"): "-0.18932333009935545208", ("a", "a"): "1.3495067443489941447"},
    ),
    "stripes-weighted": Problem(
        lambda: INT(x * B(teg.mod(x + t, 0.25) < a), (x, 0, 1)),
        {"t": 0.13, "a": 0.1},
        "0.21800000000000001144",
        {"t": "-0.4000000000000000222", "a": "2.3800000000000000044"},
        {("t", "t"): "0", ("t", "a"): "-4.0", ("a", "a"): "4.0"},
    ),
    "floor-of-a-sum-over-a-square": Problem(
        lambda: INT(teg.floor(x + y + t), *SQUARE),
        {"t": 0.3},
        "0.7999999999999999889",
        {"t": "1.0"},
        {("t", "t"): "0"},
    ),
    "floor-of-a-plane-weighted": Problem(
        lambda: INT(x * teg.floor(2 * x + a * y + t), *SQUARE),
        {"t": 0.35, "a": 1.3},
        "0.92104166666666666704",
        {"t": "0.5", "a": "0.25833333333333333148"},
        {("t", "t"): "-0.11538461538461539775", ("t", "a"): "-0.057692307692307698877", ("a", "a"): "-0.070512820512820516105"},
    ),
    "stripes-at-an-angle": Problem(
        lambda: INT(B(teg.mod(c * x + s * y + t, 0.3) < a), *SQUARE),
        {"c": 0.8, "s": 0.55, "t": 0.11, "a": 0.12},
        "0.40499999999999999811",
        {"c": "0.016477272727272488443", "s": "-0.054545454545454758393", "t": "0.090909090909090567422", "a": "3.2954545454545456616"},
        {
            ("c", "c"): "-2.3139204545454536364",
            ("c", "s"): "-0.88223140495867685719",
            ("c", "t"): "-2.3863636363636356206",
            ("c", "a"): "0.42613636363636298692",
            ("s", "s"): "-2.0743801652892551304",
            ("s", "t"): "-2.4380165289256188905",
            ("s", "a"): "0.82644628099173471557",
            ("t", "t"): "-2.2727272727272724176",
            ("t", "a"): "0",
            ("a", "a"): "0",
        },
    ),
    "checkerboard-rotated-shaded": Problem(
        lambda: INT(x * board(3 * (0.8 * x - 0.6 * y) + t, 3 * (0.6 * x + 0.8 * y), a, b), *SQUARE),
        {"t": 0.3, "a": 1.0, "b": 0.25},
        "0.29969760802469136625",
        {"t": "0.034495370370370349973", "a": "0.23293014403292182166", "b": "0.26706985596707817834"},
        {
            ("t", "t"): "-0.011157407407407398061",
            ("t", "a"): "0.045993827160493799963",
            ("t", "b"): "-0.045993827160493799963",
            ("a", "a"): "0",
            ("a", "b"): "0",
            ("b", "b"): "0",
        },
    ),
    "checkerboard-by-an-angle": Problem(
        lambda: INT(board(2 * (teg.cos(t) * x - teg.sin(t) * y), 2 * (teg.sin(t) * x + teg.cos(t) * y), a, b), *SQUARE),
        {"t": 0.3, "a": 1.0, "b": 0.25},
        "0.65741402109367678935",
        {"t": "0.21553101307511156281", "a": "0.54321869479156905247", "b": "0.45678130520843094753"},
        {
            ("t", "t"): "0.73907554934409213908",
            ("t", "a"): "0.28737468410014875041",
            ("t", "b"): "-0.28737468410014875041",
            ("a", "a"): "0",
            ("a", "b"): "0",
            ("b", "b"): "0",
        },
    ),
    "remainder-by-a-negative-number": Problem(
        lambda: INT(teg.mod(x + t, -0.3), (x, 0, 1)),
        {"t": 0.17},
        "-0.14299999999999998868",
        {"t": "0.10000000000000003331"},
        {("t", "t"): "0"},
    ),
    "remainder-by-a-negative-parameter": Problem(
        lambda: INT((x + t) % m, (x, 0, 1)),
        {"t": 0.17, "m": -0.4},
        "-0.18600000000000001843",
        {"t": "0.19999999999999995559", "m": "0.9399999999999998912"},
        {("t", "t"): "0", ("t", "m"): "2.0", ("m", "m"): "6.0"},
    ),
    "floor-of-a-square": Problem(
        lambda: INT(teg.floor(t * x * x), (x, 0, 2)),
        {"t": 1.3},
        "2.6482081941794876758",
        {"t": "2.8276122330078892588"},
        {("t", "t"): "-3.2626294996244874949"},
    ),
    "floor-of-a-wave": Problem(
        lambda: INT(teg.floor(2 * teg.sin(3 * x) + t), (x, 0, 2)),
        {"t": 0.3},
        "-0.29939678050456241155",
        {"t": "1.5958207147386523897"},
        {("t", "t"): "-0.78029095271555028071"},
    ),
    "floor-in-a-floor": Problem(
        lambda: INT(teg.floor(1.5 * teg.floor(x * t) + x + 0.2), (x, 0, 2)),
        {"t": 1.6},
        "4.5750000000000003234",
        {"t": "3.5156249999999996097"},
        {("t", "t"): "-4.3945312499999992682"},
    ),
    "round-of-a-product": Problem(
        lambda: INT(round(x * t), (x, 0, 3)),
        {"t": 1.7},
        "7.6470588235294115726",
        {"t": "4.325259515570934482"},
        {("t", "t"): "-5.0885406065540407"},
    ),
    "ceil-of-a-product": Problem(
        lambda: INT(teg.ceil(x * t), (x, 0, 3)),
        {"t": 1.7},
        "9.1764705882352938872",
        {"t": "5.1903114186851213784"},
        {("t", "t"): "-6.10624872786484884"},
    ),
    "triangle-wave": Problem(
        lambda: INT(x * teg.abs(teg.mod(2 * x + t, 1) - 0.5), (x, 0, 1)),
        {"t": 0.3},
        "0.14000000000000000028",
        {"t": "-0.024999999999999994449"},
        {("t", "t"): "-0.5"},
    ),
    "remainder-by-a-variable": Problem(
        lambda: INT(teg.mod(t, x), (x, 1, 2)),
        {"t": 3.4},
        "0.81277777777777779801",
        {"t": "-0.2277777777777777457"},
        {("t", "t"): "-0.36111111111111111111"},
    ),
    "floor-as-a-bound": Problem(
        lambda: INT(teg.exp(-x), (x, 0, teg.floor(y + t) + 1), (y, 0, 2)),
        {"t": 0.3},
        "1.5922129874330184966",
        {"t": "0.31809237280357837862"},
        {("t", "t"): "0"},
    ),
    "product-of-floors": Problem(
        lambda: INT(teg.floor(2 * x + t) * teg.floor(3 * y + a), *SQUARE),
        {"t": 0.3, "a": 0.4},
        "1.1200000000000000022",
        {"t": "1.4000000000000000222", "a": "0.7999999999999999889"},
        {("t", "t"): "0", ("t", "a"): "1.0", ("a", "a"): "0"},
    ),
    "quotient-by-a-floor": Problem(
        lambda: INT(1 / (1 + teg.floor(4 * x + t)), (x, 0, 1)),
        {"t": 0.3},
        "0.46083333333333333555",
        {"t": "-0.2"},
        {("t", "t"): "0"},
    ),
    "root-of-a-floor": Problem(
        lambda: INT(teg.sqrt(teg.floor(4 * x + t)), (x, 0, 1)),
        {"t": 0.3},
        "1.18656609248549308",
        {"t": "0.5"},
        {("t", "t"): "0"},
    ),
    "floor-up-to-a-parameter": Problem(
        lambda: INT(teg.floor(x), (x, 0, t)),
        {"t": 3.3},
        "3.8999999999999994671",
        {"t": "3.0"},
        {("t", "t"): "0"},
    ),
    "floor-between-parameters": Problem(
        lambda: INT(teg.floor(3 * x), (x, t, t + 1)),
        {"t": 0.3},
        "1.8999999999999999667",
        {"t": "3.0"},
        {("t", "t"): "0"},
    ),
    "exp-of-an-integral": Problem(
        lambda: teg.exp(INT(x * teg.floor(2 * x + t), (x, 0, 1))),
        {"t": 0.3},
        "1.7815789113950580449",
        {"t": "1.0689473468370348368"},
        {("t", "t"): "-0.24942104759530811442"},
    ),
    "floor-over-a-triangle": Problem(
        lambda: INT(teg.floor(3 * x + 2 * y + t), (x, 0, y), (y, 0, 1)),
        {"t": 0.3},
        "1.0666666666666666611",
        {"t": "0.5"},
        {("t", "t"): "0"},
    ),
    "checkerboard-scaled": Problem(
        lambda: INT(board(a * x, a * y, 1, 0), *SQUARE),
        {"a": 3.7},
        "0.503287070854638418",
        {"a": "-0.023690600754150773234"},
        {("a", "a"): "0.098177264386570817797"},
    ),
    "condition-on-two-floors": Problem(
        lambda: INT(B(teg.floor(4 * x + t) <= teg.floor(3.5 * y)), *SQUARE),
        {"t": 0.3},
        "0.49642857142857143135",
        {"t": "-0.25"},
        {("t", "t"): "0"},
    ),
    "exp-of-a-remainder": Problem(
        lambda: INT(teg.exp(a * teg.mod(3 * x + t, 1)), (x, 0, 1)),
        {"t": 0.3, "a": 0.6},
        "1.3701980006508482747",
        {"t": "0", "a": "0.75320133289943446068"},
        {("t", "t"): "0", ("t", "a"): "0", ("a", "a"): "0.52619355765273337458"},
    ),
    "two-floors-of-one-variable": Problem(
        lambda: INT(teg.floor(x * t) * teg.floor(2 * x * t), (x, 0, 2)),
        {"t": 1.3},
        "5.7692307692307697169",
        {"t": "10.946745562130176767"},
        {("t", "t"): "-16.841147018661809835"},
    ),
    "stripes-of-varying-width": Problem(
        lambda: INT(B(teg.mod(x + a, 0.25) < t * y), *SQUARE),
        {"t": 0.2, "a": 0.1},
        "0.4000000000000000222",
        {"t": "2.0", "a": "0"},
        {("t", "t"): "0", ("t", "a"): "0", ("a", "a"): "0"},
    ),
}
