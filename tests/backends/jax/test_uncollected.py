"""The collector of cyclic garbage rests in a context, and is afterwards as it was."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import numpy as np
import pytest

import teg
from teg.backends.jax.uncollected import uncollected


@pytest.fixture(autouse=True)
def collecting() -> Iterator[None]:
    """The collector runs before and after a test."""
    gc.enable()
    yield
    gc.enable()


def test_the_collector_runs_again_when_the_last_context_is_left() -> None:
    with uncollected():
        with uncollected():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled()


def test_a_collector_that_does_not_run_is_left_alone() -> None:
    gc.disable()
    with uncollected():
        assert not gc.isenabled()
    assert not gc.isenabled()


def test_an_error_leaves_the_context() -> None:
    with pytest.raises(ZeroDivisionError), uncollected():
        raise ZeroDivisionError
    assert gc.isenabled()


@pytest.mark.usefixtures("x64")
def test_programs_are_traced_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Passes, printing, tracing and lowering of a function of JAX; tracing of an evaluator's kernel."""
    from teg.backends.jax.kernel import JaxKernel

    run, seen = JaxKernel.run, []

    def noted(self: JaxKernel, *arguments: object) -> object:
        seen.append(gc.isenabled())
        return run(self, *arguments)

    monkeypatch.setattr(JaxKernel, "run", noted)
    x, t = teg.var("x"), teg.param("t")
    e = teg.integral(teg.bracket(x < t), (x, 0, 1))
    assert float(teg.jax_function(e, kernel="xla")(t=0.5)) == 0.5
    assert float(np.asarray(teg.compile(e, [t], backend="jax")(t=0.5))) == 0.5
    assert seen
    assert not any(seen)
    assert gc.isenabled()
