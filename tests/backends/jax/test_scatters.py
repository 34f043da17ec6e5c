"""Terms added to entries of arrays, row by row of lanes and one by one."""

from __future__ import annotations

import numpy as np
import pytest

jax = pytest.importorskip("jax")
jnp = jax.numpy

from teg.backends.jax.scatters import FEWEST, ROW, added, added_by_rows  # noqa: E402

LENGTHS = (FEWEST - 1, FEWEST, FEWEST + ROW + 7)
ENTRIES = {
    "in runs": lambda n, random: np.sort(random.integers(-3, 60, n)),
    "in long runs": lambda n, random: np.arange(n) // 50,
    "in short runs": lambda n, random: np.arange(n) // 3,
    "in any order": lambda n, random: random.integers(-3, 260, n),
    "in none": lambda n, random: np.full(n, -1),
}


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("how", ENTRIES)
def test_sums_are_those_of_terms_added_one_by_one(how: str, length: int, x64: None) -> None:
    random = np.random.default_rng(0)
    rows, terms = ENTRIES[how](length, random), random.normal(size=length)
    wanted = np.ones((250, 3))
    inside = (rows >= 0) & (rows < 250)
    np.add.at(wanted, (rows[inside], 1), terms[inside])
    for function in (added, added_by_rows):
        found = jax.jit(function)(jnp.ones((250, 3)), (jnp.asarray(rows), 1), jnp.asarray(terms))
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13)


def test_an_entry_that_does_not_exist_in_one_place_is_none_in_another(x64: None) -> None:
    """(0, 3) of an array (2, 3) is not its entry (1, 0)."""
    places = jnp.zeros(FEWEST, int), jnp.full(FEWEST, 3)
    assert not np.any(added_by_rows(jnp.zeros((2, 3)), places, jnp.ones(FEWEST)))


def test_rows_of_runs_are_added_in_few_terms(x64: None) -> None:
    """Of 64 lanes an entry no term is added alone, and every row adds one: what is left is the sum of 32 terms."""
    entries = jnp.arange(FEWEST) // (2 * ROW)
    graph = jax.make_jaxpr(added_by_rows)(jnp.zeros(FEWEST), (entries,), jnp.ones(FEWEST))
    adds = [e.invars[2].aval.shape for e in graph.jaxpr.eqns if e.primitive.name == "scatter-add"]
    assert adds == [(2 * FEWEST // ROW,), (FEWEST,)]
    assert (added_by_rows(jnp.zeros(FEWEST), (entries,), jnp.ones(FEWEST))[: FEWEST // (2 * ROW)] == 2 * ROW).all()


def test_nan_stays_in_its_entry(x64: None) -> None:
    entries = jnp.arange(FEWEST) // 20
    found = added_by_rows(jnp.zeros(FEWEST), (entries,), jnp.ones(FEWEST).at[30].set(np.nan))
    assert np.flatnonzero(np.isnan(found)).tolist() == [1]
