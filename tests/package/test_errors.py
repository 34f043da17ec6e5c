"""The error classes: all of them are public, documented, and raised by the example in their docstring."""

from __future__ import annotations

import doctest
import inspect
import pickle
import sys
from collections.abc import Iterator

import pytest

import teg
from teg import errors
from teg.errors import TegError

CLASSES = [c for _, c in inspect.getmembers(errors, inspect.isclass) if issubclass(c, TegError)]
OPTIONAL = {"BackendError": "jax"}


@pytest.fixture(autouse=True)
def _settings_restored(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Restores the environment, the loaded modules and JAX's 64-bit mode, which some examples change."""
    monkeypatch.setenv("CC", "cc")
    jax = sys.modules.get("jax")
    wide = jax is not None and jax.config.jax_enable_x64
    yield
    if sys.modules.get("jax") is None:
        sys.modules.pop("jax", None)
    if jax is not None:
        sys.modules["jax"] = jax
        jax.config.update("jax_enable_x64", wide)


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_the_example_of_an_error_class_raises_it(kind: type[TegError]) -> None:
    if kind.__name__ in OPTIONAL:
        pytest.importorskip(OPTIONAL[kind.__name__])
    *before, last = doctest.DocTestParser().get_examples(kind.__doc__ or "")
    names: dict[str, object] = {"teg": teg}
    for example in before:
        exec(example.source, names)
    with pytest.raises(TegError) as caught:
        exec(last.source, names)
    assert caught.type is kind or kind is TegError
    assert caught.value.what
    assert caught.value.what in str(caught.value)


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_an_error_class_says_what_why_and_the_way_out(kind: type[TegError]) -> None:
    summary, reason, *_ = inspect.getdoc(kind).split("\n\n")  # type: ignore[union-attr]
    assert summary.endswith(".")
    assert len(reason.split()) > 8


def test_every_error_class_is_reached_from_the_package() -> None:
    assert all(getattr(teg.errors, kind.__name__) is kind for kind in CLASSES)
    assert len(CLASSES) >= 17


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_an_error_survives_pickling(kind: type[TegError]) -> None:
    again = pickle.loads(pickle.dumps(kind("what", "where", "hint")))
    assert type(again) is kind
    assert (again.what, again.where, again.hint) == ("what", "where", "hint")
