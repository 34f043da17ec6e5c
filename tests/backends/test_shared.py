"""Formulas that NumPy and JAX share: one source, the same numbers from both, whichever elements are computed."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from teg.backends.numpy.arrays import NUMPY, places_of
from teg.backends.shared import polygons, rules
from teg.backends.shared.arrays import Arrays
from teg.backends.shared.bends import CUBIC, LINE, SLOW_TAIL, TAIL, Bends, Substitution, Tail, place, possible_kinds, substitution
from teg.backends.shared.poles import pole_at, pole_weights
from teg.backends.shared.roots import Ends, Halving, examined, excluded, newton_step, next_halving, plane_step, refuted
from teg.backends.shared.samples import Points, coordinate
from tests.backends.test_bends import random_places

Array = npt.NDArray[np.float64]
CLOSE: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-13}
KINDS = ("root", "end", "pole")
RATIONAL, SLOW = Tail(2.0), Tail(2.0, 325.0)


@pytest.fixture
def jax_arrays(x64: None) -> Arrays:
    from teg.backends.jax.arrays import JAX

    return JAX


def bent(arrays: Arrays, kinds: tuple[str, ...], tail: Tail = RATIONAL) -> Substitution:
    """Pieces with a bend of each kind, the last two of them tails."""
    bends = []
    for kind in kinds:
        lo, hi, c0, c1, c2, base, _, when = random_places(kind, 60)
        bends.append((kind, *(arrays.xp.asarray(c) for c in (c0, c1, c2)), arrays.xp.asarray(when > 0.0)))
    p, q = np.minimum(lo, hi), np.maximum(lo, hi)
    p[-2], q[-1] = -np.inf, np.inf
    with np.errstate(all="ignore"):
        p, q, base = map(arrays.xp.asarray, (p, q, base))
        return substitution(arrays, (p, q), Bends(base, bends), False, tail)


@pytest.mark.parametrize("kinds", [*((kind,) for kind in KINDS), ("end", "end"), KINDS], ids="+".join)
def test_substitutions(kinds: tuple[str, ...], jax_arrays: Arrays) -> None:
    import jax as of_jax

    slow = len(kinds) > 1
    tail = SLOW if slow else RATIONAL
    numpy, jax = bent(NUMPY, kinds, tail), of_jax.jit(lambda: bent(jax_arrays, kinds, tail))()
    np.testing.assert_array_equal(numpy.kind, jax.kind)
    assert set(numpy.kind) <= set(possible_kinds(kinds, False, True, slow))
    assert set(numpy.kind[-2:]) == {SLOW_TAIL if slow else TAIL}
    for name in ("centre", "radius", "start", "step"):
        np.testing.assert_allclose(getattr(numpy, name), getattr(jax, name), err_msg=name, **CLOSE)


@pytest.mark.parametrize("kinds", [KINDS, ("end",)], ids="+".join)
def test_places(kinds: tuple[str, ...], jax_arrays: Arrays) -> None:
    slow = len(kinds) > 1
    s = bent(NUMPY, kinds, SLOW if slow else RATIONAL)
    u = np.linspace(0.0, 1.0, 7)[1:-1, None] + np.zeros(s.p.size)
    numpy, jax = places_of(s, u), place(jax_arrays, s, possible_kinds(kinds, False, True, slow), u)
    for n, j in zip(numpy, jax, strict=True):
        np.testing.assert_allclose(n, j, rtol=1e-11, atol=1e-13)
    assert ((numpy[0] > s.p) & (numpy[0] < s.q)).all()
    one = [places_of(s.part(slice(i, i + 1)), u[:, i : i + 1]) for i in range(s.p.size)]  # elements do not see each other
    np.testing.assert_array_equal(np.concatenate([o[0] for o in one], axis=1), numpy[0])


@pytest.mark.parametrize("mask", [[False, False], [True, False], [True, True]])
def test_what_is_not_chosen_is_kept(mask: list[bool], jax_arrays: Arrays) -> None:
    def negated(v: Any, w: Any) -> tuple[Any]:
        return (-v * w,)

    expected = np.where(mask, [[-2.0, -4.0], [-6.0, -8.0]], [[10.0, 20.0], [30.0, 40.0]])
    for arrays in (NUMPY, jax_arrays):
        old = arrays.xp.asarray([[10.0, 20.0], [30.0, 40.0]])
        (new,) = arrays.choose(arrays.xp.asarray(mask), negated, (arrays.xp.asarray([[1.0, 2.0], [3.0, 4.0]]), 2.0), (old,))
        np.testing.assert_array_equal(new, expected)
        np.testing.assert_array_equal(old, [[10.0, 20.0], [30.0, 40.0]])


def same(xp: Any, f: Any, *arguments: Any) -> None:
    """A function gives the same with the arrays of NumPy and of another module."""
    import jax

    places = [i for i, a in enumerate(arguments) if isinstance(a, np.ndarray)]

    @jax.jit  # one program, not one for each operation
    def of_jax(arrays: Any) -> Any:
        given = dict(zip(places, arrays, strict=True))
        return f(xp, *(given.get(i, a) for i, a in enumerate(arguments)))

    with np.errstate(all="ignore"):
        first, second = f(np, *arguments), of_jax([arguments[i] for i in places])
    for n, j in zip(*(v if isinstance(v, tuple) else (v,) for v in (first, second)), strict=True):
        np.testing.assert_allclose(n, j, **CLOSE)


def test_formulas(jax_arrays: Arrays) -> None:
    xp, random = jax_arrays.xp, np.random.default_rng(1)
    a, b, c, d = random.normal(size=(4, 50))
    a[:4] = np.nan, 0.0, np.inf, -np.inf
    yes, no = b > 0.0, c > 0.3
    for n in (-5, -1, 0, 1, 12):
        same(xp, rules.powi, a, n)
    same(xp, rules.ties, 1e-14 * a, abs(b))
    same(xp, rules.resolved, yes, a, no, -1)
    same(xp, rules.is_wide, b, np.where(yes, b, c))
    same(xp, rules.rounding, np.minimum(b, c), np.maximum(b, c))
    same(xp, rules.null_rule_error, 10, random.normal(size=(6, 50)) * 10.0 ** random.uniform(-12, 0, (6, 50)), abs(b), yes)
    same(xp, rules.tolerated, (1e-9, 1e-6), abs(b), abs(c))
    same(xp, rules.is_unseen, a, b, abs(c), a > b)
    same(xp, lambda m, *v: tuple(rules.ends_of_pieces(m, v[0], v[1], v[2:])), b, c, a, d)
    same(xp, lambda m, *v: tuple(pole_at(m, 2, v[:2], v[2], v[3:5], v[5])), np.minimum(b, c), np.maximum(b, c), d, b, c, yes)
    same(xp, lambda m, low, high: pole_weights(m, 6, 2, low, high), 1.0 + abs(b), 1.0 + abs(c))
    same(xp, lambda m, *v: polygons.least_and_most(m, v[:3], v[3:]), a, b, c, d, abs(b))
    same(xp, lambda m, *v: polygons.cut(m, *v), np.zeros(50), np.ones(50), b, c, no)
    same(xp, lambda m, *v: tuple(newton_step(m, v[:2], v[2], v[3:5], v[5], v[6])), b, c, d, d - 1.0, d + 1.0, yes, abs(a))
    same(xp, lambda m, *v: tuple(examined(m, v, (b, c), abs(d), Ends(yes, no, yes | no))), b - 1, b + 1, c - 1, c + 1, d - 1, d + 1, abs(b))
    twelve = np.sort(random.normal(size=(6, 2, 50)), axis=1).reshape(12, 50)
    same(xp, excluded, twelve[:4])
    same(xp, refuted, twelve, random.normal(size=(6, 50)), abs(random.normal(size=(2, 50))))
    same(xp, plane_step, random.normal(size=(6, 50)))


def test_a_straight_piece_is_a_line_or_flat_at_its_ends() -> None:
    p, q = np.array([0.0, 1.0]), np.array([2.0, 5.0])
    for cubic, kind in ((False, LINE), (True, CUBIC)):
        s = substitution(NUMPY, (p, q), Bends(), cubic, None)
        assert set(s.kind) == {kind}
        np.testing.assert_allclose(places_of(s, np.full((1, 2), 0.5))[0], [[1.0, 3.0]])


@pytest.mark.parametrize("kind", ["qmc", "montecarlo"])
def test_random_coordinates_are_the_same_bits(kind: str, jax_arrays: Arrays) -> None:
    index, replicate = np.arange(64, dtype=np.uint64), np.zeros(64, dtype=np.int64)
    for dimension in (0, 3):
        numpy, jax = (
            coordinate(xp, Points(kind, 7, 2048), dimension, xp.asarray(replicate), xp.asarray(index)) for xp in (np, jax_arrays.xp)
        )
        np.testing.assert_array_equal(numpy, jax)
        assert ((numpy > 0.0) & (numpy < 1.0)).all()


def test_directions_take_turns_unless_one_is_useless(jax_arrays: Arrays) -> None:
    never = np.zeros((2, 3), dtype=np.bool_)
    at = Halving(np.array([[1, 1, 0], [1, 0, 0]]), np.array([0, 0, -1]), never, never)
    found = next_halving(np, at, np.array([100, 100, 1]), np.array([100, 40, 1]))
    np.testing.assert_array_equal(found.last, [0, 1, 0])
    np.testing.assert_array_equal(found.useless, [[True, False, False], [False, False, False]])
    np.testing.assert_array_equal(found.useful, [[False, True, False], [False, False, False]])
    once = Halving(np.array([2, 1]), np.array(1), np.array([False, False]), np.array([True, False]))
    assert next_halving(np, once, 100, 99).last == 0  # in u it was of no use
    same(
        jax_arrays.xp,
        lambda m, b, left: tuple(next_halving(m, Halving(*map(m.asarray, at)), b, left)),
        np.array([9, 9, 9]),
        np.array([9, 5, 1]),
    )
