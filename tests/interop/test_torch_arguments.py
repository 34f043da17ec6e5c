"""Arguments of `teg.torch_function`: batches, types, integers, shapes, devices, and what is refused or told."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import AccuracyError, ArrayIndexError, DiffeomorphismError, OptionError, ParameterError
from teg.evaluator.accuracy import AccuracyWarning
from tests.interop.torch_programs import (
    EXACT,
    GATHERED,
    HYPERBOLA,
    OF_GATHERED,
    OF_RAGGED,
    QUIET,
    RAGGED,
    STEP,
    C,
    V,
    a,
    close,
    f64,
    k,
    n,
    rng,
    t,
    x,
)

torch = pytest.importorskip("torch")
pytestmark = QUIET


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


def test_devices() -> None:
    """A number on the CPU goes with tensors of any device, and two devices are a mistake."""
    from teg.interop.torch import _common_device

    number, here, there = torch.tensor(1.0), torch.ones(2), torch.ones(2, device="meta")
    assert _common_device([number, there]) == there.device
    assert _common_device([number]) == here.device
    with pytest.raises(ParameterError, match="cpu and meta"):
        _common_device([here, there])
