"""What errors say to write instead of NumPy's functions has their values."""

from __future__ import annotations

import math

import numpy as np
import pytest

import teg
from teg.errors import ConditionError, OperandError
from teg.ir.foreign_names import OTHER_NAMES, SHARED, WRITTEN, ours

t, a = teg.params("t a")
OF_NUMPY = sorted(name for name in SHARED | set(OTHER_NAMES) | set(WRITTEN) if getattr(getattr(np, name, None), "__name__", "") == name)
OF_NUMPY = [name for name in OF_NUMPY if isinstance(getattr(np, name), np.ufunc)]
OF_CONDITIONS = [name for name in OF_NUMPY if name.startswith("logical")]
OF_NUMBERS = [name for name in OF_NUMPY if name not in (*OF_CONDITIONS, "heaviside")]


@pytest.mark.parametrize("name", OF_NUMBERS)
def test_what_is_written_instead_has_the_value_of_numpy(name: str) -> None:
    function = getattr(np, name)
    text = ours(name).removesuffix(", for u >= 0")
    written = text if "(" in text or "*" in text or "/" in text else f"{text}({', '.join('uv'[: function.nin])})"
    e = eval(written, {"teg": teg, "math": math, "u": t, "v": a, "p": a})
    values = (0.5, 0.75)[: function.nin]
    assert teg.evaluate(e, {t: 0.5, a: 0.75}) == pytest.approx(function(*values), abs=1e-15)


@pytest.mark.parametrize("name", OF_CONDITIONS)
def test_what_is_written_between_conditions_has_the_value_of_numpy(name: str) -> None:
    e = eval(f"teg.bracket({ours(name)})", {"teg": teg, "c": t > 0, "d": a > 0})
    for c in (False, True):
        for d in (False, True):
            assert teg.evaluate(e, {t: c - 0.5, a: d - 0.5}) == getattr(np, name)(*(c, d)[: getattr(np, name).nin])


@pytest.mark.parametrize(
    ("name", "written"), [("arcsin", "teg.asin"), ("absolute", "teg.abs"), ("square", r"u\*\*2"), ("isnan", "operators")]
)
def test_a_function_of_numpy_leads_to_ours(name: str, written: str) -> None:
    with pytest.raises(OperandError, match=f"(?s)numpy.{name} .*in: t\n.*write .*{written}"):
        getattr(np, name)(t)


def test_functions_of_numpy_on_conditions_and_arrays() -> None:
    with pytest.raises(ConditionError, match=r"(?s)in: t < a\n.*write c & d"):
        np.logical_and(t < a, t > 0)
    with pytest.raises(ConditionError, match="a condition is not a number"):
        np.array([1.0, 2.0]) * (t < a)
    with pytest.raises(ConditionError, match="between conditions"):
        np.isnan(t < a)  # type: ignore[call-overload]
    with pytest.raises(OperandError, match="V is an array"):
        np.sum(teg.array("V"))  # type: ignore[call-overload]
