"""Every backend on the table of problems with exact values: value, gradient, Hessian, diagnosis."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

import teg
from teg.backends.c import kernel
from tests.references import REFERENCES, Reference

KNOWN = REFERENCES
JAX_FAST = (
    "step",
    "cube-of-a-difference-tied",
    "bracket-in-a-bracket",
    "moving-bound-on-the-step-closed",
    "reversed-constant-bounds",
    "factor-zero",
    "edge-on-a-bound",
    "untaken-branch-is-nan",
    "half-plane-1e-12",
    "absolute-value",
    "aff1-step-expcos",
    "st-root-birth",
)
HESSIANS_FAST = ("half-plane-zero", "slope-of-a-line", "disjunction", "it-triangle-domain", "minimum-and-maximum")
VALUES_ALONE = frozenset(r.id for r in REFERENCES[::4])
"""Each program is a kernel of its own, which the compiler of C takes a tenth of a second for; NumPy has all of them."""


def name(reference: Reference) -> str:
    return reference.id


def is_close(found: float, exact: str, tolerance: float) -> bool:
    """Relative; absolute where the exact number is 0. Infinities must be equal."""
    want = float(exact)
    return found == want or abs(found - want) <= tolerance * (abs(want) or 1.0)


def compiled(reference: Reference, backend: str) -> teg.Evaluator:
    return teg.compile(reference.build(), [teg.param(k) for k in reference.params], backend=backend)


def check(reference: Reference, f: teg.Evaluator, hessian: bool, alone: bool = True) -> None:
    """Compares with exact numbers; `alone`: by the program of the value alone as well, where there is one of the gradient."""
    if alone or not reference.grad:
        value = f(reference.params)
        assert is_close(value, reference.value, reference.tolerance), (value, reference.value)
    if reference.grad:
        value, gradient = f.value_and_grad(reference.params)
        assert is_close(value, reference.value, reference.tolerance), (value, reference.value)
        for k, exact in reference.grad.items():
            assert is_close(gradient[k], exact, reference.tolerance), (k, gradient[k], exact)
    if hessian and reference.hess:
        found = f.hessian(reference.params)
        for (a, b), exact in reference.hess.items():
            assert is_close(found[a, b], exact, reference.tolerance), (a, b, found[a, b], exact)
            assert is_close(found[b, a], exact, reference.tolerance), (b, a, found[b, a], exact)


def test_every_reference_has_a_name_of_its_own_and_enough_digits() -> None:
    assert len({r.id for r in REFERENCES}) == len(REFERENCES)
    for r in REFERENCES:
        for number in (r.value, *r.grad.values(), *r.hess.values()):
            float(number)
        assert set(r.grad) <= set(r.params)


@pytest.mark.parametrize("reference", KNOWN, ids=name)
def test_numpy(reference: Reference) -> None:
    check(reference, compiled(reference, "numpy"), hessian=True)


@pytest.mark.parametrize("reference", [r for r in KNOWN if "slow" not in r.tags], ids=name)
def test_c(reference: Reference) -> None:
    check(reference, compiled(reference, "c"), hessian=reference.id in HESSIANS_FAST, alone=reference.id in VALUES_ALONE)


@pytest.mark.slow
@pytest.mark.parametrize("reference", [r for r in KNOWN if "slow" not in r.tags][::16], ids=name)
def test_flags_of_the_c_compiler_change_no_bit(reference: Reference, monkeypatch: pytest.MonkeyPatch) -> None:
    program = compiled(reference, "numpy").program(1)
    columns = [np.array([reference.params[k]]) for k in program.parameters]
    results = []
    for flag in ("-O0", "-O1", "-O3"):
        monkeypatch.setattr(kernel, "OPTIMISATION", ((inf, (flag,)),))
        results.append(kernel.compile_c(program)(columns, 1).tobytes())
    assert results == [results[0]] * 3


@pytest.mark.slow
@pytest.mark.parametrize("reference", [r for r in KNOWN if r.hess or "slow" in r.tags], ids=name)
def test_c_hessian(reference: Reference) -> None:
    check(reference, compiled(reference, "c"), hessian=True, alone=False)


HEAVY = (
    "ball3-clipped",
    "imp-perlin-smoothstep",
    "disk-shifted-harmonic",
    "d2-ellipse-mixed",
    "it-centroid-segment",
    "ellipse-rotated",
    "st-near-coincident-lines",
)
"""XLA compiles their second derivatives for 10 to 60 s, others for 2 to 5 s."""


@pytest.mark.parametrize("reference", [r for r in KNOWN if r.id in JAX_FAST], ids=name)
def test_jax(reference: Reference, x64: None) -> None:
    check(reference, compiled(reference, "jax"), hessian=False)


@pytest.mark.slow
@pytest.mark.parametrize("reference", [r for r in [r for r in KNOWN if "slow" not in r.tags][::6] if r.id not in HEAVY], ids=name)
def test_jax_hessian(reference: Reference, x64: None) -> None:
    check(reference, compiled(reference, "jax"), hessian="1d-affine" in reference.tags, alone=False)


@pytest.mark.parametrize("reference", [r for r in KNOWN if "coincident" not in r.tags], ids=name)
def test_diagnose(reference: Reference) -> None:
    found = compiled(reference, "numpy").diagnose(reference.params)
    kinds = {d.kind for d in found}
    if "tie" in reference.tags:
        assert kinds & {"tie", "parameter surface"}
        assert all(d.surfaces and d.message and d.parameters == reference.params for d in found)
    elif "birth" in reference.tags:
        assert kinds == {"infinite derivative"}
    else:
        assert found == []


def test_the_least_of_three_tied_parameters_is_an_average_of_nearby_gradients() -> None:
    x = teg.var("x")
    ps = teg.params("t a b")
    f = teg.compile(teg.integral(teg.bracket((x < ps[0]) & (x < ps[1]) & (x < ps[2])), (x, 0, 1)), ps)
    at = {p.name: 0.5 for p in ps}
    gradient = f.grad(at)
    assert sum(gradient.values()) == pytest.approx(1.0, abs=1e-14)
    assert all(v >= 0 for v in gradient.values())
    assert {d.kind for d in f.diagnose(at)} == {"tie"}


def test_a_delta_without_parameters_is_dropped_only_without_variables() -> None:
    z, t = teg.var("z"), teg.param("t")
    e = teg.integral(teg.diff(teg.bracket(z < t), t), (z, 0, 1))
    assert teg.evaluate(e, {t: 0.4}) == 1.0
