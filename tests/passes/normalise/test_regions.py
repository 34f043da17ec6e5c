"""Integrals over surfaces with kinks as sums over regions: distances from boxes and segments, against Steiner's formula."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

import teg
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.passes.normalise.regions import MOST_REGIONS, with_regions
from teg.pipeline import normal_form

pytestmark = pytest.mark.usefixtures("x64_for_jax")

x, y, z = teg.vars("x y z")
t, h, g, a, b, c = teg.params("t h g a b c")
S, k = teg.array("S"), teg.index("k")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
SQUARE = ((x, -1, 1), (y, -1, 1))
AT = {"t": 0.3, "h": 0.5, "g": 0.4, "a": 0.15, "b": 0.62}

Reference = tuple[teg.Expr, Callable[..., float], Callable[..., dict[str, float]]]


def hinge(u: teg.Expr) -> teg.Expr:
    return teg.maximum(u, 0)


def clamped(u: teg.Expr) -> teg.Expr:
    return teg.minimum(hinge(u), 1)


def box(u: teg.Expr, v: teg.Expr) -> teg.Expr:
    """The distance from a box, 0 inside."""
    return teg.sqrt(hinge(abs(u) - h) ** 2 + hinge(abs(v) - g) ** 2)


def signed_box(u: teg.Expr, v: teg.Expr) -> teg.Expr:
    """The distance from a box, less than 0 inside."""
    p, q = abs(u) - h, abs(v) - g
    return teg.sqrt(hinge(p) ** 2 + hinge(q) ** 2) + teg.minimum(teg.maximum(p, q), 0)


def segment(u: teg.Expr, v: teg.Expr, p: teg.Expr, q: teg.Expr) -> teg.Expr:
    """The distance from the segment between the origin and (p, q)."""
    along = clamped((u * p + v * q) / (p * p + q * q))
    return teg.sqrt((u - along * p) ** 2 + (v - along * q) ** 2)


def integrals(e: teg.Expr) -> list[Integral]:
    return [n for n in postorder([e]) if isinstance(n, Integral)]


def rounded(t: float, h: float, g: float, **_: float) -> float:
    """Returns the area within a distance of a box, by Steiner's formula."""
    return 4 * h * g + 4 * (h + g) * t + math.pi * t**2


def rounded_slopes(t: float, h: float, g: float, **_: float) -> dict[str, float]:
    return {"t": 4 * (h + g) + 2 * math.pi * t, "h": 4 * (g + t), "g": 4 * (h + t)}


def shell_slopes(t: float, h: float, g: float, a: float, **_: float) -> dict[str, float]:
    return {"t": 4 * math.pi * a, "h": 8 * a, "g": 8 * a, "a": 8 * (h + g) + 4 * math.pi * t}


turned = box(teg.cos(a) * x + teg.sin(a) * y, teg.cos(a) * y - teg.sin(a) * x)
REFERENCES: dict[str, Reference] = {
    "a box": (box(x, y) - t, rounded, rounded_slopes),
    "a box without a root": (hinge(abs(x) - h) ** 2 + hinge(abs(y) - g) ** 2 - t**2, rounded, rounded_slopes),
    "a box that moves": (box(x - a / 9, y + a * b / 9) - t, rounded, rounded_slopes),
    "a box that turns": (turned - t, rounded, rounded_slopes),
    "a signed box": (signed_box(x, y) - t, rounded, rounded_slopes),
    "inside a signed box": (
        signed_box(x, y) + t,
        lambda t, h, g, **_: 4 * (h - t) * (g - t),
        lambda t, h, g, **_: {"t": -4 * (h + g - 2 * t), "h": 4 * (g - t), "g": 4 * (h - t)},
    ),
    "a shell": (
        abs(box(x, y) - t) - a,
        lambda t, h, g, a, **_: 8 * (h + g) * a + 4 * math.pi * t * a,
        shell_slopes,
    ),
    "a segment": (
        segment(x + 0.2, y + 0.4, a, b) - t,
        lambda t, a, b, **_: 2 * math.hypot(a, b) * t + math.pi * t**2,
        lambda t, a, b, **_: {
            "t": 2 * math.hypot(a, b) + 2 * math.pi * t,
            "a": 2 * t * a / math.hypot(a, b),
            "b": 2 * t * b / math.hypot(a, b),
        },
    ),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", REFERENCES)
def test_areas(name: str, backend: str) -> None:
    surface, area, slopes = REFERENCES[name]
    program = teg.integral(teg.bracket(surface < 0), *SQUARE)
    f = teg.compile(program, [t, h, g, a, b], backend=backend)
    for at in (AT, {"t": 0.11, "h": 0.35, "g": 0.7, "a": 0.05, "b": 0.31}):
        value, grad = f.value_and_grad(at)
        assert value == pytest.approx(area(**at), rel=1e-11)
        assert dict(grad) == pytest.approx(dict.fromkeys("thgab", 0.0) | slopes(**at), rel=1e-10, abs=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
def test_hessian(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(box(x, y) < t), *SQUARE), [t, h, g], backend=backend)
    known = {"tt": 2 * math.pi, "th": 4.0, "tg": 4.0, "hh": 0.0, "hg": 4.0, "gg": 0.0}
    expected = {pair: known["".join(sorted(pair, key="thg".index))] for pair in ((p, q) for p in "thg" for q in "thg")}
    assert f.hessian(t=0.3, h=0.5, g=0.4) == pytest.approx(expected, rel=1e-10, abs=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
def test_three_dimensions(backend: str) -> None:
    distance = teg.sqrt(sum((hinge(abs(u) - h) ** 2 for u in (y, z)), hinge(abs(x) - h) ** 2))
    f = teg.compile(teg.integral(teg.bracket(distance < t), *SQUARE, (z, -1, 1)), [t, h], backend=backend)
    at = {"t": 0.3, "h": 0.5}
    volume = 8 * 0.5**3 + 24 * 0.5**2 * 0.3 + 6 * math.pi * 0.5 * 0.3**2 + 4 / 3 * math.pi * 0.3**3
    value, grad = f.value_and_grad(at)
    assert value == pytest.approx(volume, rel=1e-11)
    assert grad["t"] == pytest.approx(24 * 0.5**2 + 12 * math.pi * 0.5 * 0.3 + 4 * math.pi * 0.3**2, rel=1e-10)
    assert grad["h"] == pytest.approx(24 * 0.5**2 + 48 * 0.5 * 0.3 + 6 * math.pi * 0.3**2, rel=1e-10)


@pytest.mark.parametrize("h0", [0.0, 0.2, 1.0, -0.1])
def test_where_regions_are_empty_or_touch(h0: float) -> None:
    """A core without width, one as wide as the box, and one that is turned inside out."""
    f = teg.compile(teg.integral(teg.bracket(hinge(abs(x) - h) ** 2 + y**2 < t**2), *SQUARE), [t, h], backend="numpy")
    value = f(t=0.4, h=h0)
    half = max(h0, 0.0)
    whole = math.pi * 0.16 + 4 * half * 0.4 if half + 0.4 <= 1.0 else 1.6
    if h0 < 0.0:  # |x| - h is at least -h: a lens, twice the part of the disk beyond it
        whole = 2 * (0.16 * math.acos(-h0 / 0.4) + h0 * math.sqrt(0.16 - h0**2))
    assert value == pytest.approx(whole, rel=1e-11)


def test_normal_form() -> None:
    """Nine regions of a box: a disk at each corner, half-planes at the sides, and the inside."""
    e = teg.integral(teg.bracket(hinge(abs(x) - h) ** 2 + hinge(abs(y) - g) ** 2 < t**2), *SQUARE)
    divided = with_regions(e)
    assert sum(not n.body.has_integral for n in integrals(divided)) == 9
    assert with_regions(divided) is divided


@pytest.mark.parametrize(
    "e",
    [
        teg.bracket(abs(x) + abs(y) < t),  # half-planes as it is
        teg.bracket(teg.sin(abs(x)) + y < t),  # no quadric
        teg.bracket(hinge(x) ** 3 + y < t),
        teg.bracket(teg.where(x > 0, x**2, teg.sin(x)) + y < t),  # one side is none
        teg.bracket(hinge(x * y) ** 2 + y < t),  # its kink is no plane
        teg.bracket(hinge(x) ** 2 < t),  # in one variable there is a formula
        hinge(x) ** 2 * teg.bracket(x * x + y * y < t),  # a kink of the integrand
        teg.bracket(sum((hinge(x - teg.param(n)) ** 2 for n in "cdefijl"), y) < t),  # too many
        teg.bracket(teg.sum(hinge(x - S[k]) ** 2, (k, 0, 3)) + y * y < t),  # a kink for each index
        teg.sum(teg.bracket(hinge(x - S[k]) ** 2 + y * y < t), (k, 0, 3)),
    ],
    ids=str,
)
def test_what_stays(e: teg.Expr) -> None:
    program = teg.integral(e, *SQUARE)
    assert with_regions(program) is program


def test_an_array_of_boxes() -> None:
    """Kinks may depend on an index of a sum outside."""
    disk = teg.bracket(hinge(abs(x) - S[k]) ** 2 + y * y < t**2)
    e = teg.sum(teg.integral(disk, *SQUARE), (k, 0, teg.length(S, 0)))
    f = teg.compile(e, [t, S])
    sizes = [0.1, 0.2, 0.45]
    value, grad = f.value_and_grad(t=0.4, S=sizes)
    assert value == pytest.approx(3 * math.pi * 0.16 + 4 * 0.4 * sum(sizes), rel=1e-12)
    assert grad["t"] == pytest.approx(6 * math.pi * 0.4 + 4 * sum(sizes), rel=1e-12)
    assert list(grad["S"]) == pytest.approx([1.6] * 3, rel=1e-11)


def test_the_number_of_regions_is_bounded() -> None:
    names = "cdefij"
    e = teg.integral(teg.bracket(sum((hinge(x - teg.param(n)) ** 2 for n in names), y) < t), *SQUARE)
    divided = with_regions(e)
    assert 1 < sum(not n.body.has_integral for n in integrals(divided)) <= MOST_REGIONS


def test_estimators_see_no_edges_between_regions() -> None:
    """Where nothing jumps there is nothing to sample, or to smooth."""
    e = teg.integral(teg.bracket(hinge(abs(x) - h) ** 2 + y**2 < t**2), *SQUARE)
    assert len(integrals(normal_form(e))) > len(integrals(normal_form(e, whole=True))) == 2
    f = teg.compile(e, [t, h], discontinuities="edge-mc")
    assert f.grad(t=0.4, h=0.3) == pytest.approx({"t": 2 * math.pi * 0.4 + 4 * 0.3, "h": 4 * 0.4}, rel=0.02)
