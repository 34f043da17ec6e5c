"""`teg.torch_function` where PyTorch is not installed, or too old."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

import teg
from teg.errors import MissingPackageError


def test_a_missing_torch_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingPackageError) as caught:
        teg.torch_function(teg.param("t"))
    assert caught.value.hint == 'pip install "teg-compiler[torch]"'


def test_an_old_torch_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(__version__="2.3.1+cpu"))
    with pytest.raises(MissingPackageError) as caught:
        teg.torch_function(teg.param("t"))
    assert "2.3.1" in caught.value.what
