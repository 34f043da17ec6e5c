"""The field GF(P): inverses, quotients, residues that stand for keys and floats, and signs of small fractions."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from teg.numerics.field import P, divided, inverse, residue, residue_of_float, sign_of_residue


def test_quotients() -> None:
    assert inverse(7) * 7 % P == 1
    assert divided(10, 5) == 2
    assert divided(1, 3) * 3 % P == 1


def test_residues_of_keys_are_the_same_in_every_process() -> None:
    assert residue("t") == residue("t") != residue("s")
    assert hex(residue("t"))[:10] == "0x" + f"{residue('t'):x}"[:8]
    assert 0 <= residue("t", 3) < P


@pytest.mark.parametrize("value", [0.5, -0.375, 3.0, 1e-300, -(2.0**60)])
def test_residues_of_floats_are_those_of_their_fractions(value: float) -> None:
    exact = Fraction(value)
    assert residue_of_float(value) == divided(exact.numerator, exact.denominator)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_has_no_residue(value: float) -> None:
    assert residue_of_float(value) is None


@pytest.mark.parametrize(
    "value",
    [Fraction(1), Fraction(-2), Fraction(3, 7), Fraction(-37, 10), Fraction(2**50 + 1, 3**30), Fraction(-1, 2**60), Fraction(10**30, 7)],
)
def test_the_sign_of_a_fraction_is_recovered(value: Fraction) -> None:
    assert sign_of_residue(divided(value.numerator, value.denominator)) == (1 if value > 0 else -1)


def test_a_random_residue_has_no_sign() -> None:
    assert sign_of_residue(residue("any")) is None
    assert sign_of_residue(0) is None
