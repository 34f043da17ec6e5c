"""Sampled integrals: what the three backends make of them, how far off they are, and what they say about that."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import teg
from teg.analysis.settings import Integration
from teg.backends.c.kernel import compile_c
from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from teg.ir.expr import const
from teg.ir.integral import integral_over
from teg.passes.differentiate.estimators.exact import Exact
from teg.pipeline import Elimination, compiled_outputs, flat_program, flatten
from teg.program import Adaptive, Arg, Assign, Integrate, Program, Sample, Stmt, Tie

Array = npt.NDArray[np.float64]
KINDS = ("montecarlo", "qmc")
BACKENDS = ("numpy", "c", "jax")
COMPILERS: dict[str, Callable[[Program], Any]] = {"numpy": compile_numpy, "c": compile_c, "jax": compile_jax}

x, y, z = teg.vars("x y z")
t, a = teg.params("t a")
pytestmark = pytest.mark.usefixtures("x64")


def let(name: str, op: str, *args: Arg) -> Assign:
    return Assign(name, op, args)


def program(*body: Stmt, outputs: Sequence[Arg], parameters: int = 1) -> Program:
    return Program(tuple(f"p{i}" for i in range(parameters)), body, tuple(outputs), (Tie(("one", "other")),))


def run(p: Program, *columns: float | Array, backend: str = "numpy") -> Array:
    """The outputs, (outputs, n)."""
    arrays = [np.asarray(c, dtype=np.float64) for c in columns]
    n = max((c.size for c in arrays), default=1)
    found: Array = COMPILERS[backend](p)(arrays, n)
    return found


def scheduled(e: teg.Expr, rule: str, *names: str, orders: int = 0, order: int | None = None, seed: int = 0) -> Program:
    outputs = compiled_outputs(e, [teg.param(n) for n in names], orders, Exact(), Elimination(closed_forms=False))
    return flat_program([o for entry in outputs for o in flatten(entry)], names, Integration(rule=rule, order=order, seed=seed))


BODY = (
    let("v1", "mul", "x1", "p0"),
    let("v2", "exp", "v1"),
    let("v3", "mul", "v2", "x2"),
    let("v4", "sub", "x1", "x2"),
    let("b1", "gt0", "v4"),
    let("v5", "select", "b1", "v3", 0.0),
)


def sample(kind: str, count: int, estimates: int, seed: int = 3, when: str | None = None) -> Sample:
    """A smooth value and one that jumps; the third coordinate is not used."""
    errors = ("v12", "v13")[:estimates]
    return Sample(("x1", "x2", "x3"), count, kind, seed, BODY, ("v3", "v5"), ("v10", "v11"), errors, when)


@cache
def reference(kind: str, count: int, seed: int, p: float) -> tuple[Array, Array]:
    """Means and standard errors of the two values, from the points and the formulas of `teg.program`."""
    from teg.backends.numpy.samples import points
    from teg.numerics.sobol import replicated

    replicates, each = replicated(kind, count)
    u, v, _ = points(kind, seed, 3, count, 0, replicates * each)
    values = np.array([np.exp(u * p) * v, np.where(u > v, np.exp(u * p) * v, 0.0)])
    means = values.reshape(2, replicates, each).mean(axis=2)
    if kind == "qmc":
        return means.mean(axis=1), means.std(axis=1, ddof=1) / math.sqrt(replicates)
    return values.mean(axis=1), values.std(axis=1, ddof=1) / math.sqrt(each)


# -- the statement -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1000, 8192, 9001])
def test_means_and_standard_errors(kind: str, count: int, backend: str) -> None:
    p = program(sample(kind, count, 2), outputs=("v10", "v11", "v12", "v13"))
    columns = np.array([-1.0, 0.5, 2.0])
    found = run(p, columns, backend=backend)
    for i, value in enumerate(columns):
        means, errors = reference(kind, count, 3, float(value))
        assert found[:2, i] == pytest.approx(means, rel=1e-13)
        assert found[2:, i] == pytest.approx(errors, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", KINDS)
def test_estimates_are_for_the_first_values_only(kind: str, backend: str) -> None:
    both = run(program(sample(kind, 500, 2), outputs=("v10", "v11", "v12")), 0.3, backend=backend)
    one = run(program(sample(kind, 500, 1), outputs=("v10", "v11", "v12")), 0.3, backend=backend)
    assert np.array_equal(both, one)
    none = run(program(sample(kind, 500, 0), outputs=("v10", "v11")), 0.3, backend=backend)
    assert none == pytest.approx(both[:2], rel=1e-15)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", KINDS)
def test_results_are_the_same_each_time_and_differ_by_seed(kind: str, backend: str) -> None:
    first, again, other, large = (
        run(program(sample(kind, 100, 0, seed), outputs=("v10",)), 0.3, backend=backend)[0, 0] for seed in (3, 3, 4, 2**64 + 3)
    )
    assert first == again == large
    assert first != other


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", KINDS)
def test_when_it_is_not_needed_it_is_0(kind: str, backend: str) -> None:
    p = program(let("b9", "gt0", "p0"), sample(kind, 100, 2, when="b9"), outputs=("v10", "v11", "v12", "v13"))
    found = run(p, np.array([-1.0, 1.0]), backend=backend)
    assert not found[:, 0].any()
    assert found[:, 1].all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", KINDS)
def test_nan_and_inf(kind: str, backend: str) -> None:
    """One NaN among the samples makes the mean NaN, an inf makes it inf; there is no standard error then."""
    body = (let("v1", "sub", "x1", "p0"), let("b1", "gt0", "v1"), let("v2", "select", "b1", "x1", "p1"))
    s = Sample(("x1",), 64, kind, 0, body, ("v2",), ("v3",), ("v4",))
    p = program(s, outputs=("v3", "v4"), parameters=2)
    found = run(p, 0.5, np.array([math.nan, math.inf, -math.inf, 0.0]), backend=backend)
    assert np.isnan(found[:, 0]).all()
    assert list(found[0, 1:3]) == [math.inf, -math.inf]
    assert np.isnan(found[1, 1:3]).all()
    assert np.isfinite(found[:, 3]).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_single_sample_has_no_standard_error(backend: str) -> None:
    found = run(program(sample("montecarlo", 1, 2), outputs=("v10", "v12")), 0.3, backend=backend)
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", KINDS)
def test_ties_are_averaged(kind: str, backend: str) -> None:
    """x > ½ or not, by the order, where the other surface ties along the whole sample."""
    body = (let("v1", "sub", "x1", 0.5), let("b1", "gt0", "v1"), let("v2", "sub", "p0", 1.0), let("b2", "tie", "v2", 1.0, "b1", 0))
    p = program(Sample(("x1",), 1024, kind, 0, (*body, let("v3", "select", "b2", "x1", 0.0)), ("v3",), ("v4",)), outputs=("v4",))
    whole, tied = run(p, np.array([2.0, 1.0]), backend=backend)[0]
    assert tied == pytest.approx(0.5 * whole, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_chunks_do_not_matter(kind: str) -> None:
    p = program(sample(kind, 40000, 2), outputs=("v10", "v11", "v12", "v13"))
    columns = [np.linspace(-1.0, 1.0, 700)]
    wide, narrow = compile_numpy(p)(columns, 700), compile_numpy(p, memory=2**18)(columns, 700)
    assert narrow == pytest.approx(wide, rel=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_evaluations_are_counted(kind: str) -> None:
    p = program(sample(kind, 1001, 0), outputs=("v10",))
    wanted = 3 * (1008 if kind == "qmc" else 1001)
    columns = [np.array([0.1, 0.2, 0.3])]
    assert compile_numpy(p).outcome(columns, 3).evaluations == wanted
    assert compile_c(p, counted=True).outcome(columns, 3).evaluations == wanted


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_integral_inside_a_sample(backend: str) -> None:
    inner = Integrate("x3", 0.0, "x1", (), (), None, (let("v1", "exp", "x3"),), ("v1",), ("v2",), Adaptive(1e-10))
    p = program(Sample(("x1",), 4096, "qmc", 0, (inner,), ("v2",), ("v5",)), outputs=("v5",))
    assert run(p, 0.0, backend=backend)[0, 0] == pytest.approx(math.e - 2.0, abs=5e-5)


def test_a_long_body_is_cut_into_parts() -> None:
    """900 terms sin(k·x)·p: several C functions, which take the coordinate out of the workspace."""
    body = [let(f"v{k}", "mul", "x1", float(k)) for k in range(1, 901)]
    body += [let(f"v{900 + k}", "sin", f"v{k}") for k in range(1, 901)]
    total = let("v2000", "add", *(f"v{900 + k}" for k in range(1, 901)))
    p = program(Sample(("x1",), 4096, "qmc", 0, (*body, total), ("v2000",), ("v3000",), ("v3001",)), outputs=("v3000", "v3001"))
    exact = sum((1.0 - math.cos(k)) / k for k in range(1, 901))
    values = [run(p, 0.0, backend=b)[:, 0] for b in ("numpy", "c")]
    assert values[0] == pytest.approx(values[1], rel=1e-9)
    assert abs(values[0][0] - exact) < 6 * values[0][1]


# -- honesty -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "within"), [("montecarlo", 0.683), ("qmc", 0.649)])
def test_standard_errors_are_honest(kind: str, within: float) -> None:
    """Over 1000 seeds the error is within one standard error as often as a normal number is, or, with 8 replicates, one of Student's
    distribution with 7 degrees of freedom; and nearly always within 4 of them."""
    exact = np.array([(math.e - 1.0) / 2.0, (math.e - 2.0) / 2.0])
    away = []
    for seed in range(1000):
        means, errors = reference(kind, 512, seed, 1.0)
        away.append(np.abs(means - exact) / errors)
    assert np.mean(np.array(away) < 1.0, axis=0) == pytest.approx(within, abs=0.05)
    assert (np.mean(np.array(away) < 4.0, axis=0) > 0.985).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_replicates_that_count_the_same_points_have_an_error(backend: str) -> None:
    """Of a jump along one coordinate every replicate counts 61 points of 64 or 62, and for one seed of two all count the same."""
    jump = (let("v1", "sub", "p0", "x1"), let("b1", "gt0", "v1"), let("v2", "select", "b1", 3.0, 0.0))
    p = 0.9585
    for seed in range(4):
        statement = Sample(("x1",), 512, "qmc", seed, jump, ("v2",), ("v3",), ("v4",))
        value, error = run(program(statement, outputs=("v3", "v4")), p, backend=backend)[:, 0]
        assert 3.0 / 64 / 100 < error < 3.0 / 64, seed
        assert abs(value - 3.0 * p) < 4.0 * error
    constant = Sample(("x1",), 512, "qmc", 1, (let("v2", "mul", "p0", 0.1),), ("v2",), ("v3",), ("v4",))
    assert run(program(constant, outputs=("v3", "v4")), p, backend=backend)[1, 0] < 1e-15


def test_rates_on_a_smooth_and_on_a_discontinuous_integrand() -> None:
    def spread(e: teg.Expr, exact: float, rule: str, order: int) -> float:
        errors = [run(scheduled(e, rule, order=order, seed=s))[0, 0] - exact for s in range(24)]
        return float(np.sqrt(np.mean(np.square(errors))))

    def rate(e: teg.Expr, exact: float, rule: str) -> float:
        return math.log(spread(e, exact, rule, 2**7) / spread(e, exact, rule, 2**13), 2**6)

    cube = ((x, 0, 1), (y, 0, 1), (z, 0, 1))
    smooth, exact = teg.integral(teg.exp(x + y / 2 + z / 4), *cube), (math.e - 1) * 2 * (math.e**0.5 - 1) * 4 * (math.e**0.25 - 1)
    disk = teg.integral(teg.bracket(x * x + y * y < 1), *cube[:2])
    assert 0.3 < rate(smooth, exact, "montecarlo") < 0.7
    assert rate(smooth, exact, "qmc") > 1.0
    assert 0.3 < rate(disk, math.pi / 4, "montecarlo") < 0.7
    assert rate(disk, math.pi / 4, "qmc") > 0.6


# -- programs ----------------------------------------------------------------------------------------------------------

DISK = teg.integral(teg.bracket(x * x + y * y < t), (x, -1, 1), (y, -1, 1))
CLIPPED = teg.integral(teg.bracket((x < t) & (x + a * y < 1.2)) * teg.exp(x * y), (x, 0, 1), (y, 0, 1))
NESTED = teg.integral(
    teg.sin(teg.integral(x * y * z * t, (z, 0, y))) + teg.integral(teg.bracket(z < x) * y, (z, x - a, 1)), (x, 0, y), (y, 0, 1)
)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_gradient_of_a_disk(backend: str) -> None:
    """The area to 1e-3 and, its boundary being smooth, the gradient to 1e-4."""
    area, slope = run(scheduled(DISK, "qmc", "t", orders=1), np.array([0.5, 0.25]), backend=backend)
    assert area == pytest.approx([math.pi / 2, math.pi / 4], rel=3e-3)
    assert slope == pytest.approx([math.pi, math.pi], rel=1e-4)


@pytest.mark.parametrize("rule", [*KINDS, "midpoint"])
@pytest.mark.parametrize(("e", "names", "orders"), [(CLIPPED, ("t", "a"), 1), (NESTED, ("t", "a"), 1)])
def test_backends_agree(e: teg.Expr, names: tuple[str, ...], orders: int, rule: str) -> None:
    p = scheduled(e, rule, *names, orders=orders, order=None if rule in KINDS else 40)
    values = np.array([0.7, 0.4]), np.array([0.8, 1.1])
    found = [run(p, *values, backend=b) for b in BACKENDS]
    exact = run(scheduled(e, "auto", *names, orders=orders), *values)
    for other in found[1:]:
        assert other == pytest.approx(found[0], rel=1e-11, abs=1e-13)
    assert found[0] == pytest.approx(exact, rel=0.05, abs=0.02)


@pytest.mark.slow
def test_the_sum_of_many_seeds_is_the_integral() -> None:
    """Value, gradient and Hessian are unbiased: their means over 36 seeds are as near as those say."""
    exact = run(scheduled(CLIPPED, "auto", "t", "a", orders=2), 0.7, 0.8)[:, 0]
    for rule in KINDS:
        programs = [scheduled(CLIPPED, rule, "t", "a", orders=2, order=256, seed=s) for s in range(36)]
        found = np.array([run(p, 0.7, 0.8)[:, 0] for p in programs])
        error = found.std(axis=0, ddof=1) / 6.0
        assert (np.abs(found.mean(axis=0) - exact) < 5.0 * error + 1e-12).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("rule", KINDS)
def test_tails(rule: str, backend: str) -> None:
    """∫exp(-x²) over the line, half-lines, and backwards."""
    half, ends = (
        0.5 * math.sqrt(math.pi),
        [(-math.inf, math.inf), (0.0, math.inf), (-math.inf, 0.0), (math.inf, 0.0), (math.inf, -math.inf)],
    )
    bodies = [integral_over(teg.exp(-x * x), x, const(lo), const(hi)) for lo, hi in ends]
    found = run(scheduled(teg.tuple(*bodies), rule), backend=backend)[:, 0]
    assert found == pytest.approx([2 * half, half, half, -half, -2 * half], rel=2e-5 if rule == "qmc" else 0.05)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("rule", [*KINDS, "midpoint"])
def test_reversed_bounds_and_none(rule: str, backend: str) -> None:
    found = run(
        scheduled(teg.integral(x, (x, t, a)), rule, "t", "a"), np.array([1.0, 2.0, math.nan]), np.array([0.0, 2.0, 1.0]), backend=backend
    )
    assert found[0, 0] == pytest.approx(-0.5, abs=0.01)
    assert found[0, 1] == 0.0
    assert np.isnan(found[0, 2])


# -- compiled by users -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rule", "backend"), [*((r, b) for r in (*KINDS, "midpoint") for b in ("numpy", "c")), ("qmc", "jax")])
def test_values_come_with_their_errors(rule: str, backend: str) -> None:
    """The volume of a ball in five dimensions (a disk's area by midpoints) and its derivative."""
    variables = teg.vars("x1 x2 x3 x4 x5") if rule in KINDS else teg.vars("x1 x2")
    n = len(variables)
    ball = teg.integral(teg.bracket(sum((v * v for v in variables), start=0 * t) < t), *((v, -1, 1) for v in variables))
    f = teg.compile(ball, [t], backend=backend, rule=rule, order=2**13 if rule in KINDS else 100, seed=1)
    unit = math.pi ** (n / 2) / math.gamma(n / 2 + 1)
    value, error = f.value_and_error(t=0.8)
    assert 0.0 < error < 0.1 * value
    assert abs(value - unit * 0.8 ** (n / 2)) < 4.0 * error
    (_, gradient), (slope, slope_error) = f.value_and_grad(t=0.8), (d["t"] for d in f.grad_and_error(t=0.8))
    assert gradient["t"] == pytest.approx(slope, rel=1e-12)
    assert 0.0 < slope_error < 0.1 * slope
    assert abs(slope - unit * n / 2 * 0.8 ** (n / 2 - 1)) < 4.0 * slope_error


def test_seeds_are_an_option() -> None:
    values = [float(teg.compile(DISK, [t], rule="montecarlo", seed=s)(t=0.5)) for s in (0, 0, 1)]
    assert values[0] == values[1] != values[2]


def test_explain_has_the_rule_and_the_count() -> None:
    data = teg.compile(DISK, [t], rule="qmc", order=1000).explain().data
    assert {i["rule"] for i in data["integrals"]} == {"scrambled Sobol' points, 1000 in all"}
    assert data["cost"]["value"]["evaluations"] == 1000
    data = teg.compile(DISK, [t], rule="midpoint", order=20).explain().data
    assert {(i["rule"], i["nodes"], i["breaks"]) for i in data["integrals"]} == {("midpoint", 20, 0)}
