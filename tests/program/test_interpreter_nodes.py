"""The tape of the calls of a function: sums and products keep the origin, other operations use the value."""

from __future__ import annotations

import pytest

from teg.program.interpreter.nodes import Noted, Tape


def test_the_weights_are_the_derivatives_by_the_calls() -> None:
    tape = Tape()
    first, second, unused = tape.call((0.5,)), tape.call((1.5,)), tape.call((2.5,))
    value = 3.0 * (first - 2.0 * second) / 4.0 + first - (-second) + 1.0
    assert isinstance(value, Noted)
    assert float(value) == pytest.approx(3 * (1 - 2) / 4 + 1 + 1 + 1)
    weights = {tape.points[number][0]: weight for number, weight in tape.weights(value).items()}
    assert weights == pytest.approx({0.5: 1.75, 1.5: -0.5})
    assert unused.number not in tape.weights(value)
    assert not tape.weights(1.0)


def test_sums_shared_by_two_terms_count_twice() -> None:
    tape = Tape()
    call = tape.call((0.0,))
    half = 0.5 * call
    assert list(tape.weights(sum([half, half, 1.0 - half])).values()) == [0.5]
    assert type(abs(call)) is float
