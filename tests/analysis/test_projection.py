"""Slices of solids: where two of their curves meet on a side of the box is found to the last digit, so no call warns, and estimates hold
the errors of slices with branch points close to each other.

References: mpmath with 30 digits, areas of slices in closed form; volumes of caps and lenses in closed form.
"""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

import teg
from teg.ir.expr import Expr
from tests.backends.c_checks import in_c

pytestmark = pytest.mark.filterwarnings("error")

x, y, z = teg.vars("x y z")
t, d, a, b, c, p, q = teg.params("t d a b c p q")
u, v, w, s = teg.params("u v w s")
CUBE = ((x, 0, 1), (y, 0, 1), (z, 0, 1))
BACKENDS = ("numpy", pytest.param("c", marks=in_c))


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("backend", ["numpy", "jax", pytest.param("c", marks=in_c)])
def test_a_ball_and_a_plane(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket((x * x + y * y + z * z < t) & (x + y - z > d - 0.4)), *CUBE), [t, d], backend=backend)
    value, slopes = f.value_and_grad(t=0.45, d=0.37)
    assert value == pytest.approx(0.12780226891100108, rel=1e-14)
    assert slopes == pytest.approx({"t": 0.42178719238926490, "d": -0.12661111942216020}, rel=1e-11)
    _, estimate = f.value_and_error(t=0.45, d=0.37)
    assert estimate < 1e-13


@pytest.mark.parametrize(
    "inside",
    [
        (x * x + y * y + z * z < t) & (a * x + b * y + c * z > d),
        ((x - p) ** 2 + (y - q) ** 2 + z * z < t) & (a * x + b * y + c * z > d),
        (x * x + y * y < t) & (a * x + b * y + c * z > d),
        (x * x + y * y < z * z * t) & (a * x + b * y + c * z > d),
        (x * x + y * y + z * z < t) & (a * x + b * y > d) & (x - c * z < 0.4),
    ],
    ids=["ball", "ball elsewhere", "cylinder", "cone", "two planes"],
)
def test_planes_with_coefficients(inside: Expr) -> None:
    f = teg.compile(teg.integral(teg.bracket(inside), *CUBE), [t], backend="numpy")
    given = {"t": [0.3, 0.45, 0.7], "d": [0.37, 0.4, 0.6], "a": 0.9, "b": [0.7, 1.2, 1.1], "c": [0.35, -0.2, 0.8], "p": 0.2, "q": 0.31}
    _, estimates = f.value_and_error({name: given[name] for name in f.parameters})
    assert max(estimates) < 1e-10


def caps(count: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Returns balls in the cube and planes that cut them, as columns, and the volumes of what is cut off."""
    random = np.random.default_rng(0)
    centre, r = random.uniform(0.35, 0.65, (3, count)), random.uniform(0.05, 0.34, count)
    normal = random.normal(size=(3, count))
    normal /= np.linalg.norm(normal, axis=0)
    at = random.uniform(-0.95, 0.95, count) * r
    columns = (*centre, *normal, r * r, (normal * centre).sum(axis=0) + at)
    return dict(zip("pqsuvwtd", columns, strict=True)), math.pi * (r - at) ** 2 * (2 * r + at) / 3


@pytest.mark.filterwarnings("ignore::teg.AccuracyWarning")
@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("backend", ["numpy", "jax", pytest.param("c", marks=in_c)])
def test_estimates_of_caps(backend: str) -> None:
    """In one of a hundred the cap ends so near to the pole of its ball that the nodes of a slice do not see that: 7e-11 of 3e-3."""
    ball = (x - p) ** 2 + (y - q) ** 2 + (z - s) ** 2 < t
    f = teg.compile(teg.integral(teg.bracket(ball & (u * x + v * y + w * z > d)), *CUBE[::-1]), [t], backend=backend)
    columns, volumes = caps({"c": 2000, "numpy": 400, "jax": 200}[backend])
    values, estimates = f.value_and_error(columns)
    errors = np.abs(values - volumes)
    assert (errors <= estimates + 1e-15).all()
    assert (errors <= 1e-10 * volumes).all()
    assert (estimates <= 1e-9 * volumes).mean() > 0.98


@pytest.mark.parametrize("backend", BACKENDS)
def test_two_balls(backend: str) -> None:
    """Where their slices touch is found as a double root, to half of its digits, but the area of a slice is continuous there."""
    first, second, r = (0.4, 0.4, 0.45), (0.6, 0.55, 0.5), 0.3
    balls = [(x - u0) ** 2 + (y - v0) ** 2 + (z - w0) ** 2 < t for u0, v0, w0 in (first, second)]
    f = teg.compile(teg.integral(teg.bracket(balls[0] & balls[1]), *CUBE), [t], backend=backend)
    apart = math.dist(first, second)
    value, estimate = f.value_and_error(t=r * r)
    assert value == pytest.approx(math.pi * (4 * r + apart) * (2 * r - apart) ** 2 / 12, rel=1e-14)
    assert estimate < 1e-9
    slope = math.pi * ((2 * r - apart) ** 2 + (4 * r + apart) * (2 * r - apart)) / (6 * r)
    assert f.grad(t=r * r)["t"] == pytest.approx(slope, rel=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_two_balls_with_parameters(backend: str) -> None:
    """No call warns, and the volumes of lenses are right. Reference: closed form."""
    random = np.random.default_rng(1)
    r, normal, middle = random.uniform(0.05, 0.22, 40), random.normal(size=(3, 40)), random.uniform(0.45, 0.55, (3, 40))
    apart = random.uniform(0.2, 1.95, 40) * r
    normal *= 0.5 * apart / np.linalg.norm(normal, axis=0)
    balls = [(x - u0) ** 2 + (y - v0) ** 2 + (z - w0) ** 2 < t for u0, v0, w0 in ((p, q, s), (a, b, c))]
    f = teg.compile(teg.integral(teg.bracket(balls[0] & balls[1]), *CUBE), [t], backend=backend)
    values = f(dict(zip("pqsabct", (*(middle - normal), *(middle + normal), r * r), strict=True)))
    np.testing.assert_allclose(values, math.pi * (4 * r + apart) * (2 * r - apart) ** 2 / 12, rtol=1e-10)


def lenses(count: int, *apart: float) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Returns pairs of balls in the cube, so many radii apart, as columns, the volumes of their lenses, and the slopes of these in r²."""
    random = np.random.default_rng(3)
    r, normal, middle = random.uniform(0.03, 0.2, count), random.normal(size=(3, count)), random.uniform(0.42, 0.58, (3, count))
    d = np.exp(random.uniform(*np.log(apart), count)) * r
    normal *= 0.5 * d / np.linalg.norm(normal, axis=0)
    volume = math.pi * (4 * r + d) * (2 * r - d) ** 2 / 12
    slope = math.pi * ((2 * r - d) ** 2 + (4 * r + d) * (2 * r - d)) / (6 * r)
    return dict(zip("pqsabct", (*(middle - normal), *(middle + normal), r * r), strict=True)), volume, slope


LENS = teg.bracket(((x - p) ** 2 + (y - q) ** 2 + (z - s) ** 2 < t) & ((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2 < t))


@pytest.mark.parametrize("backend", BACKENDS)
def test_balls_that_nearly_coincide(backend: str) -> None:
    """The curve in which they meet is small terms of coefficients that are large: it is computed around the centre of one of them."""
    f = teg.compile(teg.integral(LENS, *CUBE[::-1]), [t], backend=backend)
    columns, volume, _ = lenses({"c": 300, "numpy": 40}[backend], 0.005, 0.1)
    np.testing.assert_allclose(f(columns), volume, rtol=1e-11)
    at = {"p": 0.47808916, "q": 0.49599252, "s": 0.54364955, "a": 0.47695857, "b": 0.49508909, "c": 0.54371636, "t": 0.0699**2}
    apart = math.dist([at[n] for n in "pqs"], [at[n] for n in "abc"])
    assert f(at) == pytest.approx(math.pi * (4 * 0.0699 + apart) * (2 * 0.0699 - apart) ** 2 / 12, rel=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_slopes_of_lenses(backend: str) -> None:
    """Where the arcs of a slice begin is no break of their integral over the slices; they were lost where they begin just in front of
    the end of an interval."""
    f = teg.compile(teg.integral(LENS, *CUBE), [t], backend=backend)
    columns, _, slope = lenses({"c": 400, "numpy": 60}[backend], 0.1, 1.95)
    found, estimates = f.grad_and_error(columns)
    np.testing.assert_allclose(found["t"], slope, rtol=1e-9)
    assert (np.abs(found["t"] - slope) <= 2.0 * estimates["t"] + 1e-12 * slope).all()


@pytest.mark.parametrize("backend", BACKENDS[1:])
def test_slopes_of_lenses_in_a_sum(backend: str) -> None:
    """In a sum over data, slopes break where the values do as well."""
    k, balls, sizes = teg.index("k"), teg.array("balls", 2), teg.array("sizes")
    apart = [(x - balls[k, i]) ** 2 + (y - balls[k, i + 1]) ** 2 + (z - balls[k, i + 2]) ** 2 < sizes[k] for i in (0, 3)]
    total = teg.sum(teg.integral(teg.bracket(apart[0] & apart[1]), *CUBE), (k, 0, teg.length(sizes)))
    columns, volume, slope = lenses(100, 0.1, 1.95)
    given = {"balls": np.stack([columns[name] for name in "pqsabc"], axis=1), "sizes": columns["t"]}
    f = teg.compile(total, [sizes], backend=backend)
    assert f(given) == pytest.approx(volume.sum(), rel=1e-11)
    found, estimates = (result["sizes"] for result in f.grad_and_error(given))
    assert found == pytest.approx(slope, rel=1e-11)
    assert (np.abs(found - slope) <= estimates + 1e-13 * slope).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_root_by_a_tangent_crosses_a_bound(backend: str) -> None:
    """y·atan(x) + t = 0 is x = tan(-t/y), which crosses x = -1 once; tan(-t/y) does so without end as y goes to 0.

    The derivative is ∫ dy/|y/(1 + x²)| over the boundary, with w = t/y: ∫ 1/(w·cos² w) dw from t to π/4.
    """
    f = teg.compile(teg.integral(teg.bracket(y * teg.atan(x) > -t), (x, -1, 1), (y, 0, 1)), [t], backend=backend)
    expected = mpmath.quad(lambda w: 1 / (w * mpmath.cos(w) ** 2), [0.05, mpmath.pi / 4])
    assert f.grad(t=0.05)["t"] == pytest.approx(float(expected), rel=1e-10)


OVER_A_TRIANGLE = {
    "exp": (teg.exp(2 * x), lambda r: mpmath.exp(2 * r), [math.log(0.4) / 2]),
    "tan": (teg.tan(x / 2), lambda r: mpmath.tan(r / 2), [-2 * math.atan(0.2), 2 * math.atan(0.4)]),
    "sinh": (teg.sinh(x), mpmath.sinh, [-math.asinh(0.2), math.asinh(0.4)]),
}
"""Functions h, and the places where h is -b or 2·b, for b = 0.2."""


@pytest.mark.parametrize("name", OVER_A_TRIANGLE)
def test_surfaces_over_triangles_that_turn_over(name: str) -> None:
    """∫ dz ∫₀ᶻ dx |{y in (-1, 2): y·b < h(x)}| with z from -1 to 2: the bounds of x meet at z = 0, where all roots cross both.

    A length is h/b + 1 where -1 < h/b < 2, and x is in as many (0, z) as there are numbers in (x, 2), or in (-1, x) with the sign -1.
    """
    inside, h, places = OVER_A_TRIANGLE[name]
    f = teg.compile(teg.integral(teg.bracket(y * b < inside), (x, 0, z), (y, -1, 2), (z, -1, 2)), [b])
    value, slopes = f.value_and_grad(b=0.2)

    def times(r: mpmath.mpf) -> mpmath.mpf:
        return 2 - r if r > 0 else -1 - r

    ends = sorted([-1.0, 0.0, 2.0, *places])
    total = mpmath.quad(lambda r: times(r) * (1 + min(2, max(-1, h(r) / 0.2))), ends)
    by_b = mpmath.quad(lambda r: -times(r) * h(r) / 0.04 if -0.2 < h(r) < 0.4 else 0, ends)
    assert value == pytest.approx(float(total), rel=1e-11)
    assert slopes["b"] == pytest.approx(float(by_b), rel=1e-9)


def graphs(factor: Expr) -> tuple[Expr, ...]:
    """y·(x - a)·f - b·(x - ½)·f and the same of c and d, written as sums of monomials of x, for a factor f = x + s."""
    s = factor - x
    return tuple(y * x * x + (s - m) * y * x - s * m * y - n * x * x + (0.5 - s) * n * x + 0.5 * s * n for m, n in ((a, b), (c, d)))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("shift", [0.2, 0.0])
def test_surfaces_with_a_common_factor(shift: float, backend: str) -> None:
    """Two curves y = b·(x - ½)/(x - a), each beside the line x = -s: the places where the curves meet are found although the lines are one.
    The derivative is an integral along the seen part of the second curve."""
    first, second = graphs(x + shift)
    body = teg.bracket((first < 0) & (second < 0))
    f = teg.compile(teg.integral(body, (x, 0, 1), (y, 0, 1)), [c, d], backend=backend)
    g = f.grad(a=0.55, b=0.72, c=0.8, d=0.2)
    at = (np.arange(2_000_000) + 0.5) / 2_000_000
    height = 0.2 * (at - 0.5) / (at - 0.8)
    seen = (height > 0) & (height < 1) & (height * (at - 0.55) < 0.72 * (at - 0.5))
    outwards = np.sign(at - 0.8) * seen  # below the curve on the right of its pole, above it on the left
    assert g["c"] == pytest.approx((outwards * height / (at - 0.8)).mean(), abs=3e-6)
    assert g["d"] == pytest.approx((outwards * height / 0.2).mean(), abs=3e-6)
