"""`teg.torch_function`: derivatives of every order and by every way of PyTorch, against the evaluators and against formulas."""

from __future__ import annotations

import copy
import io
import math
import pickle
import shutil
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import AccuracyError, ArrayIndexError, DiffeomorphismError, OptionError, ParameterError
from teg.evaluator.accuracy import AccuracyWarning

torch = pytest.importorskip("torch")
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning"),  # of PyTorch's own modules, as they are first imported
    pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor:UserWarning"),  # its compiler looks at it
    pytest.mark.filterwarnings("ignore:Attempted to insert a get_attr Node:UserWarning"),  # torch.func.linearize
]
f64 = torch.float64

EXACT = "c" if any(map(shutil.which, ("cc", "gcc", "clang"))) else "numpy"
x, y = teg.vars("x y")
t, a = teg.params("t a")
unit = (x, 0, 1), (y, 0, 1)
STEP = teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1))
HALF_PLANE = teg.integral(teg.bracket(x + a * y < t), *unit)  # t²/2a where t < 1, a
HYPERBOLA = teg.integral(teg.bracket(x * y < t) * (a + x), *unit)
CORNERS = teg.params("x0 y0 x1 y1 x2 y2")


def inside(corners: Any) -> Any:
    """The points of a triangle, counterclockwise."""
    pairs = [corners[0:2], corners[2:4], corners[4:6]]
    product = 1
    for (px, py), (qx, qy) in zip(pairs, pairs[1:] + pairs[:1], strict=True):
        product = product * teg.bracket((qx - px) * (y - py) - (qy - py) * (x - px) > 0)
    return product


TRIANGLE = teg.integral(inside(CORNERS) * (1 + a * x), *unit)
OF_TRIANGLE = dict(zip(["x0", "y0", "x1", "y1", "x2", "y2", "a"], (-0.2, 0.15, 0.9, 0.3, 0.4, 1.3, 0.6), strict=True))

k, j, n = teg.index("k"), teg.index("j"), teg.param("n")
V, C = teg.array("V", 2), teg.array("C", 1)
F, S = teg.indices("F", 2), teg.indices("S", 1)
EDGE = teg.integral(teg.bracket(x * V[F[k, 0], 0] < V[F[k, 1], 1] + t * x) * (x + t), (x, 0, 1))
GATHERED = teg.sum(C[k] * EDGE, (k, 0, teg.length(F, 0))) ** 2
PART = teg.sum(V[j, 1] * teg.integral(teg.bracket(x * V[j, 0] < C[k] * t), (x, 0, 1)), (j, S[k], S[k + 1]))
RAGGED = teg.sum(PART * PART * C[k], (k, 0, teg.length(C, 0)))
rng = np.random.default_rng(0)
OF_GATHERED = {"t": 0.7, "V": rng.uniform(0.2, 1.5, (4, 2)), "C": rng.normal(size=3), "F": rng.integers(0, 4, (3, 2))}
OF_RAGGED = {"t": 0.6, "V": rng.uniform(0.5, 1.5, (6, 2)), "C": rng.uniform(0.2, 1, 3), "S": np.array([0, 2, 2, 6])}


@dataclass(frozen=True)
class Case:
    """A program, and a point where it has second derivatives."""

    name: str
    e: Any
    at: dict[str, Any]
    backend: str = EXACT


CASES = (
    Case("a step", STEP, {"t": 0.5, "a": 1.1}, "numpy"),
    Case("a half-plane", HALF_PLANE, {"t": 0.5, "a": 1.2}),
    Case("a hyperbola", HYPERBOLA, {"t": 0.3, "a": 0.7}),
    Case("a triangle on a pixel", TRIANGLE, OF_TRIANGLE),
    Case("gathered", GATHERED, OF_GATHERED),
    Case("ragged", RAGGED, OF_RAGGED, "numpy"),
    Case("a tuple", teg.tuple(STEP, teg.tuple(t * a, STEP * HALF_PLANE)), {"t": 0.5, "a": 1.1}),
    Case("a batch", HALF_PLANE * a, {"t": np.array([[0.3], [0.6]]), "a": np.array([0.8, 1.2, 1.4])}),
)
EVERY = pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)


def close(found: Any, wanted: Any, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(np.asarray(found), np.asarray(wanted), rtol=tolerance, atol=tolerance)


def leaves_of(at: dict[str, Any]) -> dict[str, Any]:
    """The real values as tensors that require gradients."""
    return {name: torch.tensor(v, dtype=f64, requires_grad=True) for name, v in at.items() if name not in "FSn"}


def flat(value: Any) -> list[Any]:
    return [v for entry in value for v in flat(entry)] if isinstance(value, tuple) else [value]


def positional(f: Any, at: dict[str, Any]) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """A function of the real values in order, with the integers held fixed."""
    leaves = leaves_of(at)
    fixed = {name: v for name, v in at.items() if name not in leaves}

    def call(*values: Any) -> Any:
        found = flat(f({**fixed, **dict(zip(leaves, values, strict=True))}))
        return found[0] if len(found) == 1 else tuple(found)

    return call, tuple(leaves.values())


# -- against the evaluators, and against differences -----------------------------------------------------------------------


@EVERY
def test_against_the_evaluator(case: Case) -> None:
    """Values, gradients of a weighted sum of all entries, and the derivative of these along a direction: of the product the evaluator's
    `hvp` is."""
    f, exact = teg.torch_function(case.e, backend=case.backend), teg.compile(case.e, backend=EXACT)
    leaves = leaves_of(case.at)
    at = {**case.at, **leaves}
    found, wanted = flat(f(at)), flat(exact(case.at))
    for one, other in zip(found, wanted, strict=True):
        close(one.detach(), other)
        assert one.dtype == f64
        assert one.shape == np.shape(other)
    weights = [torch.tensor(np.cos(np.arange(v.numel()) + i).reshape(v.shape), dtype=f64) for i, v in enumerate(found)]
    loss = sum((w * v).sum() for w, v in zip(weights, found, strict=True))
    slopes = torch.autograd.grad(loss, leaves.values(), create_graph=True)
    along = {name: np.sin(1 + np.arange(v.numel())).reshape(v.shape) for name, v in leaves.items()}
    second = torch.autograd.grad(sum((s * torch.tensor(u)).sum() for s, u in zip(slopes, along.values(), strict=True)), leaves.values())
    first_exact, second_exact = exact.grad(case.at), exact.hvp(case.at, along)
    for (name, leaf), one, two in zip(leaves.items(), slopes, second, strict=True):
        close(one.detach(), summed(first_exact[name], weights, leaf))
        close(two, summed(second_exact[name], weights, leaf), 1e-11)


def summed(parts: Any, weights: list[Any], leaf: Any) -> Any:
    """Derivatives of all entries and elements, by their weights, as a gradient of the shape of what they are by."""
    total = 0.0
    for part, w in zip(flat(parts), weights, strict=True):
        total = total + np.asarray(part) * w.numpy().reshape(w.shape + (1,) * (np.ndim(part) - w.ndim))
    total = np.asarray(total)
    total = total.sum(axis=tuple(range(total.ndim - leaf.ndim)))
    return total.sum(axis=tuple(i for i, m in enumerate(leaf.shape) if m == 1), keepdims=True)


@EVERY
def test_against_differences(case: Case) -> None:
    call, values = positional(teg.torch_function(case.e, backend=case.backend), case.at)
    assert torch.autograd.gradcheck(call, values, check_forward_ad=True, check_batched_grad=True, check_batched_forward_grad=True)
    assert torch.autograd.gradgradcheck(call, values, check_fwd_over_rev=True)


def test_third_derivatives_by_all_ways() -> None:
    """∂³/∂t³ ∫₀ᵗ eᵃˣ dx = a²eᵃᵗ."""
    f, func = teg.torch_function(STEP), torch.func
    call = lambda s, b: f(t=s, a=b)  # noqa: E731
    at = torch.tensor(0.5, dtype=f64), torch.tensor(1.1, dtype=f64)
    ways = {
        "reverse over reverse over reverse": func.grad(func.grad(func.grad(call))),
        "forward over reverse over reverse": func.jacfwd(func.grad(func.grad(call))),
        "forward over forward over forward": func.jacfwd(func.jacfwd(func.jacfwd(call))),
        "reverse over forward over reverse": func.grad(func.jacfwd(func.grad(call))),
        "reverse over reverse over forward": func.grad(func.grad(func.jacfwd(call))),
    }
    for name, third in ways.items():
        np.testing.assert_allclose(third(*at), 1.1**2 * math.exp(0.55), rtol=1e-13, err_msg=name)
    mixed = func.grad(func.jacfwd(func.grad(call, 0), 1), 0)
    close(mixed(*at), (1 + 0.55) * math.exp(0.55), 1e-13)
    s = torch.tensor(0.5, dtype=f64, requires_grad=True)
    found = f(t=s, a=1.1)
    for power in range(4):
        (found,) = torch.autograd.grad(found, s, create_graph=True)
        close(found.detach(), 1.1**power * math.exp(0.55))


def test_hessians_by_all_ways() -> None:
    """The area is t²/2a."""
    f = teg.torch_function(HALF_PLANE, backend=EXACT)
    call, func = lambda p: f(t=p[0], a=p[1]), torch.func
    p = torch.tensor([0.5, 1.2], dtype=f64)
    wanted = [[1 / 1.2, -0.5 / 1.44], [-0.5 / 1.44, 0.25 / 1.2**3]]
    for hessian in (func.hessian(call), func.jacrev(func.jacrev(call)), func.jacrev(func.jacfwd(call)), func.jacfwd(func.jacfwd(call))):
        close(hessian(p), wanted)
    close(torch.autograd.functional.hessian(call, p), wanted)
    u = torch.tensor([0.7, -0.4], dtype=f64)
    for product in (torch.autograd.functional.hvp, torch.autograd.functional.vhp):
        close(product(call, p, u)[1], np.array(wanted) @ u.numpy())
    close(func.jvp(func.grad(call), (p,), (u,))[1], np.array(wanted) @ u.numpy())
    value, linear = func.linearize(call, p)
    close(value, 0.25 / 2.4)
    close(linear(u), 0.7 * 0.5 / 1.2 + 0.4 * 0.25 / (2 * 1.44))


def test_vmap() -> None:
    f, func, exact = teg.torch_function(GATHERED, backend=EXACT), torch.func, teg.compile(GATHERED, backend=EXACT)
    points = torch.tensor(rng.uniform(0.2, 1.5, (4, 2, 3)), dtype=f64)  # the mapped axis is the last one
    many, fixed = torch.linspace(0.3, 0.9, 2, dtype=f64), {"C": torch.tensor(OF_GATHERED["C"]), "F": OF_GATHERED["F"]}
    call = lambda v, s: f({**fixed, "V": v, "t": s})  # noqa: E731
    mapped = func.vmap(func.vmap(func.grad(call, (0, 1)), (None, 0)), (2, None))(points, many)
    inner = func.grad(lambda v: func.vmap(func.vmap(call, (None, 0)), (2, None))(v, many).sum())(points)
    for i in range(3):
        for m in range(2):
            slopes = exact.grad({**OF_GATHERED, "V": points[..., i].numpy(), "t": float(many[m])})
            close(mapped[0][i, m], slopes["V"])
            close(mapped[1][i, m], slopes["t"])
    close(inner, mapped[0].sum(1).movedim(0, -1))
    indices = torch.tensor(rng.integers(0, 4, (5, 3, 2)))
    found = func.vmap(lambda r: f({**OF_GATHERED, "F": r}))(indices)
    close(found, [exact({**OF_GATHERED, "F": r}) for r in indices.numpy()])


# -- what is computed, and when -------------------------------------------------------------------------------------------


def test_what_requires_no_gradient_computes_none() -> None:
    f = teg.torch_function(HALF_PLANE)

    def orders() -> list[int]:
        (kernels,) = f._compiled._table.values()
        return sorted(key.wanted.orders - 1 + len(key.wanted.along) for key in kernels.kernels._kernels)

    s, b = torch.tensor(0.5, dtype=f64), torch.tensor(1.2, dtype=f64)
    assert not f(t=s, a=b).requires_grad
    s.requires_grad_()
    with torch.no_grad():
        f(t=s, a=b)
    with torch.inference_mode():
        f(t=s, a=b)
    assert orders() == [-1]
    found = f(t=s, a=b)
    (slope,) = torch.autograd.grad(found, s, create_graph=True)
    assert orders() == [-1, 0]
    torch.autograd.grad(slope, s)
    assert orders() == [-1, 0, 1]


def test_constants_have_no_derivative() -> None:
    f = teg.torch_function(STEP, [t])
    assert f.parameters == ("t", "a")
    s, b = torch.tensor(0.5, dtype=f64, requires_grad=True), torch.tensor(1.1, dtype=f64, requires_grad=True)
    found = torch.autograd.grad(f(t=s, a=b), (s, b), allow_unused=True)
    close(found[0], math.exp(0.55))
    assert found[1] is None
    assert not f(t=0.5, a=b).requires_grad
    close(torch.func.jvp(lambda s, b: f(t=s, a=b), (s, b), (s * 0 + 2, b))[1].detach(), 2 * math.exp(0.55))


def test_graphs_are_freed_and_kept() -> None:
    f = teg.torch_function(STEP)
    s = torch.tensor(0.5, dtype=f64, requires_grad=True)
    found = f(t=s, a=1.1)
    found.backward(retain_graph=True)
    found.backward()
    close(s.grad, 2 * math.exp(0.55))
    with pytest.raises(RuntimeError, match="second time"):
        found.backward()
    moved = s * 1.0
    found = f(t=moved, a=1.1)
    moved.mul_(2.0)
    with pytest.raises(RuntimeError, match="inplace operation"):
        found.backward()


def test_values_may_be_changed_in_place() -> None:
    f = teg.torch_function(HALF_PLANE)
    s = torch.linspace(0.2, 0.8, 3, dtype=f64, requires_grad=True)
    found = f(t=s, a=1.2)
    found.mul_(2.0)
    found[1] = 0.0
    found.sum().backward()
    close(s.grad, 2 * np.array([0.2, 0.0, 0.8]) / 1.2)
    other = f(t=s.detach(), a=1.2)
    other.mul_(s)  # type: ignore[arg-type]
    assert other.requires_grad


def test_ties_and_numbers_that_are_none() -> None:
    e = teg.integral(teg.bracket(x < t) * teg.bracket(x < a), (x, 0, 1))
    f, exact = teg.torch_function(e), teg.compile(e)
    s = torch.tensor([0.2, 0.5, math.nan, 0.7], dtype=f64, requires_grad=True)
    found = f(t=s, a=0.5)
    close(found.detach(), exact(t=s.detach().numpy(), a=0.5))
    found[[0, 1, 3]].sum().backward()
    close(s.grad[[0, 1, 3]], [1.0, 0.5, 0.0])
    assert torch.isnan(found[2])


def test_discontinuities_ignored() -> None:
    f = teg.torch_function(STEP, discontinuities="ignore")
    found = torch.func.hessian(lambda p: f(t=p[0], a=p[1]))(torch.tensor([0.5, 1.1], dtype=f64))
    exact = teg.compile(STEP, discontinuities="ignore").hessian(t=0.5, a=1.1)
    close(found, [[0.0, 0.0], [0.0, exact["a", "a"]]])


# -- arguments -------------------------------------------------------------------------------------------------------------


def test_batches_of_every_layout() -> None:
    f, exact = teg.torch_function(STEP, backend=EXACT, threads=2), teg.compile(STEP, backend=EXACT)
    base = torch.linspace(0.1, 0.9, 24, dtype=f64).reshape(4, 6).requires_grad_()
    for view in (base.T, base[::2, 1::2], base.flip(0), base[:, :1].expand(4, 5), base[0].expand(2, 3, 6), base[1:1], base[0, 0].expand(3)):
        rates = torch.linspace(0.5, 1.5, view.shape[-1], dtype=f64).requires_grad_()
        found = f(t=view, a=rates)
        slopes = torch.autograd.grad(found.sum(), (base, rates))
        at = {"t": view.detach().numpy(), "a": rates.detach().numpy()}
        close(found.detach(), exact(at))
        wanted = exact.grad(at)
        close(slopes[1], wanted["a"].reshape(-1, rates.numel()).sum(axis=0))
        close(slopes[0], torch.autograd.grad(view, base, torch.tensor(np.ascontiguousarray(wanted["t"])))[0])
    scalar = torch.tensor(0.4, dtype=f64, requires_grad=True)
    assert f(t=scalar, a=1).shape == ()
    assert f(t=scalar.expand(0, 3), a=1.0).shape == (0, 3)
    (none,) = torch.autograd.grad(f(t=scalar.expand(0, 3), a=1.0).sum(), scalar)
    assert none == 0.0
    negative = torch.complex(torch.zeros(2, dtype=f64), torch.tensor([-0.3, -0.6], dtype=f64)).conj().imag
    assert negative.is_neg()
    close(f(t=negative, a=1.0), exact(t=[0.3, 0.6], a=1.0))


def test_tensors_are_not_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels read doubles and 64-bit integers where they lie, and what the whole batch shares once."""
    from teg.evaluator.kernels import DerivativeKernels

    read: list[Any] = []
    run = DerivativeKernels.run

    def spied(self: Any, order: int, entry: int | None, operands: Any, n: int) -> Any:
        read.append(operands)
        return run(self, order, entry, operands, n)

    monkeypatch.setattr(DerivativeKernels, "run", spied)
    f = teg.torch_function(GATHERED)
    at = {name: torch.tensor(OF_GATHERED[name], requires_grad=name != "F") for name in "VCF"}
    many = torch.linspace(0.3, 0.9, 6, dtype=f64).reshape(2, 3).requires_grad_()
    f({**at, "t": many}).sum().backward()
    (operands,) = read
    for name, operand in zip(f.parameters, operands, strict=True):
        assert np.shares_memory(operand, {**at, "t": many}[name].detach().numpy())
        assert operand.shape == ((6,) if name == "t" else OF_GATHERED[name].shape)


def test_batches_of_arrays() -> None:
    f, exact = teg.torch_function(RAGGED, backend=EXACT), teg.compile(RAGGED, backend=EXACT)
    points = torch.tensor(rng.uniform(0.5, 1.5, (2, 1, 6, 2)), requires_grad=True)
    many = torch.linspace(0.4, 0.8, 3, dtype=f64, requires_grad=True)
    rows = torch.tensor(np.array([[0, 2, 2, 6], [0, 1, 5, 6]])[:, None], dtype=torch.int32)
    found = f({V: points, "t": many, "S": rows, "C": OF_RAGGED["C"]})
    at = {"V": points.detach().numpy(), "t": many.detach().numpy(), "S": rows.numpy(), "C": OF_RAGGED["C"]}
    assert found.shape == (2, 3)
    close(found.detach(), exact(at))
    slopes, wanted = torch.autograd.grad(found.sum(), (points, many)), exact.grad(at)
    close(slopes[0], wanted["V"].sum(axis=1, keepdims=True))
    close(slopes[1], wanted["t"].sum(axis=0))


def test_types_follow_the_arguments() -> None:
    f = teg.torch_function(STEP)
    single, double = torch.tensor([0.5], requires_grad=True), torch.tensor(1.1, dtype=f64)
    assert f(t=single, a=double).dtype == torch.float32  # as the sum of both is
    assert f(t=single[0], a=double).dtype == f64
    assert f(t=single, a=np.array([1.1])).dtype == f64
    assert f(t=0.5, a=1).dtype == torch.float32
    assert f(t=torch.tensor([1]), a=double).dtype == f64
    assert f(t=np.longdouble(0.5), a=True).dtype == torch.float32
    assert teg.torch_function(STEP, dtype=f64)(t=single, a=1).dtype == f64
    assert teg.torch_function(STEP, dtype="float32")(t=0.5, a=double).dtype == torch.float32
    for kind, tolerance in ((torch.float32, 1e-6), (torch.bfloat16, 1e-2), (torch.float16, 1e-3)):
        s = torch.tensor([0.5, 0.75], dtype=kind, requires_grad=True)
        found = f(t=s, a=1.0)
        found.sum().backward()
        assert found.dtype == s.grad.dtype == kind
        close(s.grad.double(), np.exp([0.5, 0.75]), tolerance)
    close(teg.torch_function(teg.integral(x * x, (x, 0, 3)))({}), 9.0)


def test_single_precision_is_double_inside() -> None:
    """Second derivatives too are off by the rounding of arguments and results only."""
    f, exact = teg.torch_function(HYPERBOLA, backend=EXACT), teg.compile(HYPERBOLA, backend=EXACT)
    p = torch.tensor([0.3, 0.7])
    found = torch.func.hessian(lambda p: f(t=p[0], a=p[1]))(p)
    assert found.dtype == torch.float32
    wanted = exact.hessian(t=float(p[0]), a=float(p[1]))
    close(found, [[wanted[r, c] for c in "ta"] for r in "ta"], 3e-7)


def test_integers_at_the_call_and_before() -> None:
    e = teg.sum(C[k] * teg.integral(teg.bracket(x < t * k / n), (x, 0, 1)), (k, 0, n))
    coefficients = torch.tensor([1.0, 2.0, 3.0], dtype=f64, requires_grad=True)
    for f, given in ((teg.torch_function(e), {"n": 3}), (teg.torch_function(e, indices={n: 3}), {})):
        found = f({"C": coefficients, "t": torch.tensor(0.6, dtype=f64)}, **given)
        close(found.detach(), 0.2 * (2 + 2 * 3))
        close(torch.autograd.grad(found, coefficients)[0], [0.0, 0.2, 0.4])
    f = teg.torch_function(e)
    many = f(C=coefficients, t=0.6, n=torch.tensor([1, 2, 3]))
    close(many.detach(), [0.0, 0.6, 1.6])
    with pytest.raises(ArrayIndexError):
        f(C=coefficients, t=0.6, n=2.5)
    with pytest.raises(ArrayIndexError):
        f(C=coefficients, t=0.6, n=4)


def test_programs_for_the_lengths_of_arrays() -> None:
    """A sum inside of a condition is written out for the shapes of each call."""
    e = teg.integral(teg.bracket(teg.sum(C[k] * x, (k, 0, teg.length(C, 0))) < t), (x, 0, 1))
    f = teg.torch_function(e)
    for length in (2, 3, 2):
        c = torch.full((length,), 1.0, dtype=f64, requires_grad=True)
        found = f(C=c, t=0.5)
        close(found.detach(), 0.5 / length)
        close(torch.autograd.grad(found, c)[0], np.full(length, -0.5 / length**2))
    assert len(list(f._compiled)) == 2


@pytest.mark.parametrize(
    "given",
    [
        {"t": 0.5},
        {"t": 0.5, "a": 1.0, "b": 2.0},
        {"t": 0.5, "a": 1j},
        {"t": 0.5, "a": torch.tensor(1j)},
        {"t": 0.5, "a": "one"},
        {"t": 0.5, "a": [torch.tensor(1.0), torch.tensor(2.0)]},
        {"t": 0.5, "a": torch.ones(2).to_sparse()},
        {"t": 0.5, "a": torch.ones(2, device="meta")},
        {"t": torch.ones(2), "a": np.ones(3)},
        [0.5, 1.0],
    ],
    ids=["missing", "unknown", "complex", "complex tensor", "text", "tensors", "sparse", "meta", "shapes", "a list"],
)
def test_what_is_given_wrongly(given: Any) -> None:
    with pytest.raises(ParameterError):
        teg.torch_function(STEP)(given)


def test_indices_that_are_given_wrongly() -> None:
    f = teg.torch_function(GATHERED)
    for wrong in (OF_GATHERED["F"] + 2, OF_GATHERED["F"].astype(float), torch.tensor([[True, False]]), torch.tensor([0, 1])):
        with pytest.raises((ArrayIndexError, ParameterError)):
            f({**OF_GATHERED, "F": wrong})
    assert f({**OF_GATHERED, "F": torch.zeros((0, 2))}) == 0.0


def test_given_twice_and_unknown_options() -> None:
    with pytest.raises(ParameterError):
        teg.torch_function(STEP)({"t": 0.5, "a": 1.0}, a=1.0)
    with pytest.raises(ParameterError):
        teg.torch_function(STEP, indices={"t": 3})
    with pytest.raises(OptionError):
        teg.torch_function(STEP, backend="jax")
    with pytest.raises(OptionError):
        teg.torch_function(STEP, dtype=torch.int64)


@pytest.mark.slow
def test_missed_tolerances_are_told() -> None:
    """∫₀¹ sin(t/x) dx has infinitely many waves near 0, and so have its derivatives."""
    e = teg.integral(teg.sin(t / x), (x, 0, 1))
    s = torch.tensor([-1.0, 1.0], dtype=f64, requires_grad=True)
    f = teg.torch_function(e)
    with pytest.warns(AccuracyWarning, match="the value misses the tolerance 1e-10 at t = -1.*error estimate") as caught:
        found = f(t=s.detach())
    assert caught[0].filename == __file__
    close(found, [-0.5040670619069284, 0.5040670619069284], 1e-2)
    with pytest.warns(AccuracyWarning, match="the derivative by t"):
        (slope,) = torch.autograd.grad(f(t=s).sum(), s, create_graph=True)
    with pytest.warns(AccuracyWarning, match="the derivative of order 2 by t") as caught:
        slope.sum().backward()
    assert caught[0].filename == __file__
    with pytest.raises(AccuracyError, match="t = -1"):
        teg.torch_function(e, inaccurate="raise")(t=s)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        teg.torch_function(e, inaccurate="ignore")(t=s).sum().backward()


def test_missed_tolerances_of_arrays() -> None:
    f = teg.torch_function(teg.sum(t * teg.integral(teg.sin(C[k] / x), (x, 0, 1)), (k, 0, teg.length(C, 0))), params=[t])
    s = torch.tensor(2.0, dtype=f64, requires_grad=True)
    with pytest.warns(AccuracyWarning, match="the value misses the tolerance 1e-10 at t = 2"):
        found = f(C=[1.0], t=s.detach())
    close(found, 2 * 0.5040670619069284, 1e-2)
    with pytest.warns(AccuracyWarning, match="the value|the derivative by t"):
        f(C=[1.0], t=s).backward()
    close(s.grad, 0.5040670619069284, 1e-2)


def test_maps_are_verified() -> None:
    u = teg.var("u")
    shifted = teg.Diffeomorphism({x: u - t}, {u: x + t}, domain={u: (t, 1 + t)})
    e = teg.integral(teg.bracket(x + t < a) * x, (x, 0, 1))
    f = teg.torch_function(e, maps=[shifted])
    s = torch.tensor(0.2, dtype=f64, requires_grad=True)
    close(torch.autograd.grad(f(t=s, a=0.8), s)[0], -0.6)
    wide = teg.torch_function(teg.integral(teg.bracket(x + t < a) * x, (x, -1, 1)), maps=[shifted])
    with pytest.raises(DiffeomorphismError):
        wide(t=s, a=0.8)
    unchecked = teg.torch_function(wide.expression, maps=[shifted], check_maps=False)
    unchecked(t=s, a=0.8)


# -- in programs of PyTorch --------------------------------------------------------------------------------------------------


class Halves(torch.nn.Module):
    """A module that holds a function and one of its parameters."""

    def __init__(self) -> None:
        super().__init__()
        self.area = teg.torch_function(HALF_PLANE, backend=EXACT)
        self.slope = torch.nn.Parameter(torch.tensor(1.2, dtype=f64))

    def forward(self, s: Any) -> Any:
        return self.area(t=torch.sigmoid(s), a=self.slope)


def test_a_module_learns_and_is_copied_and_saved() -> None:
    model = Halves()
    s = torch.linspace(-2, 1, 5, dtype=f64)
    wanted = torch.sigmoid(s) ** 2 / 3.0  # the slope 1.5
    optimiser = torch.optim.SGD(model.parameters(), lr=8.0)
    for _ in range(100):
        optimiser.zero_grad()
        loss = ((model(s) - wanted) ** 2).mean()
        loss.backward()
        optimiser.step()
    close(model.slope.detach(), 1.5, 1e-3)
    file = io.BytesIO()
    torch.save(model, file)
    file.seek(0)
    for other in (copy.deepcopy(model), torch.load(file, weights_only=False), pickle.loads(pickle.dumps(model))):
        close(other(s).detach(), model(s).detach())
        assert "t, a" in repr(other.area)
    functional = torch.func.functional_call(model, {"slope": torch.tensor(1.0, dtype=f64)}, (s,))
    close(functional, torch.sigmoid(s) ** 2 / 2)


def test_checkpoints() -> None:
    from torch.utils.checkpoint import checkpoint

    f = teg.torch_function(STEP)
    s = torch.tensor(0.5, dtype=f64, requires_grad=True)
    (slope,) = torch.autograd.grad(checkpoint(lambda s: f(t=s, a=1.1), s, use_reentrant=False), s, create_graph=True)
    (second,) = torch.autograd.grad(slope, s)
    close(second, 1.1 * math.exp(0.55))


def test_threads_share_one_function() -> None:
    f = teg.torch_function(STEP, backend=EXACT)
    start = threading.Barrier(4)

    def run(i: int) -> Any:
        start.wait()
        s = torch.full((50,), 0.5 + 0.01 * i, dtype=f64, requires_grad=True)
        f(t=s, a=1.1).sum().backward()
        return s.grad[-1]

    with ThreadPoolExecutor(4) as pool:
        close(list(pool.map(run, range(4))), np.exp(1.1 * (0.5 + 0.01 * np.arange(4))))


@pytest.mark.slow
def test_in_compiled_functions() -> None:
    """A call stands between two graphs."""
    from torch._dynamo.testing import CompileCounter

    model, counter = Halves(), CompileCounter()
    compiled = torch.compile(lambda s: (model(s * 2) ** 2).sum(), backend=counter)
    s = torch.linspace(-1, 1, 4, dtype=f64, requires_grad=True)
    for _ in range(2):
        found, wanted = compiled(s), (model(s * 2) ** 2).sum()
        close(found.detach(), wanted.detach())
        close(torch.autograd.grad(found, s)[0], torch.autograd.grad(wanted, s)[0])
    assert counter.frame_count >= 2
    assert counter.op_count >= 4


@pytest.mark.gpu
def test_on_a_gpu() -> None:
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    f = teg.torch_function(HALF_PLANE)
    s = torch.linspace(0.2, 0.8, 3, dtype=f64, device="cuda", requires_grad=True)
    b = torch.tensor(1.2, dtype=f64, requires_grad=True)  # a number may lie on the CPU
    found = f(t=s, a=b)
    assert found.device == s.device
    slopes = torch.autograd.grad(found.sum(), (s, b), create_graph=True)
    assert slopes[0].device == s.device
    assert slopes[1].device.type == "cpu"
    close(slopes[0].detach().cpu(), np.linspace(0.2, 0.8, 3) / 1.2)
    close(torch.autograd.grad(slopes[0].sum(), s)[0].cpu(), np.full(3, 1 / 1.2))
    with pytest.raises(ParameterError):
        f(t=s, a=torch.ones(3, dtype=f64))


def test_devices() -> None:
    """A number on the CPU goes with tensors of any device, and two devices are a mistake."""
    from teg.interop.torch import _common_device

    number, here, there = torch.tensor(1.0), torch.ones(2), torch.ones(2, device="meta")
    assert _common_device([number, there]) == there.device
    assert _common_device([number]) == here.device
    with pytest.raises(ParameterError, match="cpu and meta"):
        _common_device([here, there])


@pytest.mark.slow
def test_loads_no_compiler() -> None:
    """A gradient imports neither PyTorch's compiler nor JAX."""
    program = (
        "import sys, teg, torch; x, t = teg.var('x'), teg.param('t');"
        "f = teg.torch_function(teg.integral(teg.bracket(x < t), (x, 0, 1)));"
        "f(t=torch.tensor([0.5], requires_grad=True)).sum().backward();"
        "print(*[m for m in ('torch._dynamo', 'jax') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split() == []
