"""`teg.torch_function`: derivatives of every order and by every way of PyTorch, against the evaluators and against formulas."""

from __future__ import annotations

import copy
import io
import math
import pickle
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import ParameterError
from tests.interop.torch_programs import (
    EVERY,
    EXACT,
    GATHERED,
    HALF_PLANE,
    OF_GATHERED,
    QUIET,
    STEP,
    Case,
    a,
    close,
    f64,
    flat,
    leaves_of,
    positional,
    rng,
    t,
    x,
)

torch = pytest.importorskip("torch")
pytestmark = QUIET

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
