"""The inverses of erf and erfc: to rounding over their whole range, against 40 digits."""

from __future__ import annotations

import mpmath
import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.passes.lower.inverse_erf import inverse_of_erf, inverse_of_erfc

c = teg.param("c")


@pytest.mark.parametrize("value", [1e-300, 1e-8, 0.1, 0.49, 0.5, 0.51, 0.9, 0.999999, 1 - 2.0**-53])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_inverse_of_erf(value: float, sign: int) -> None:
    with mpmath.workdps(40):
        exact = float(mpmath.erfinv(sign * mpmath.mpf(value)))
    assert float(values_of([inverse_of_erf(c)], {c: sign * value})[0]) == pytest.approx(exact, rel=5e-15)


@pytest.mark.parametrize("value", [1e-300, 1e-100, 1e-8, 0.3, 0.5, 0.9, 1.0, 1.2, 1.7, 1.9999])
def test_the_inverse_of_erfc(value: float) -> None:
    with mpmath.workdps(340):
        exact = float(mpmath.erfinv(1 - mpmath.mpf(value)))
    assert float(values_of([inverse_of_erfc(c)], {c: value})[0]) == pytest.approx(exact, rel=5e-15, abs=1e-300)


def test_beyond_the_range_there_is_no_number() -> None:
    assert values_of([inverse_of_erf(c)], {c: 1.5})[0] != values_of([inverse_of_erf(c)], {c: 1.5})[0]
