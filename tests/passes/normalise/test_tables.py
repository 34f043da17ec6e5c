"""Numbers of candidates from tables: the same values and derivatives as without."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import teg
from teg.evaluator import derivation
from teg.ir.node import postorder
from teg.ir.partition import Partition
from teg.ir.tables import Table, TableEntry
from teg.passes.differentiate.through_sums import outlined
from teg.passes.normalise.integers import with_sums_of_integers
from teg.passes.normalise.tables import with_tables
from teg.program.arrays import AddTo, Blank, Cells, Rows, Run, steps
from teg.program.interpreter import interpret_arrays

Array = Any
SIZE = 6
P, C, F, L, R = teg.array("P", 2), teg.array("C"), teg.indices("F", 2), teg.indices("L"), teg.indices("R", 2)
s = teg.param("s")


def scene(by: float = 0.0, names: str = "ijk") -> teg.Expr:
    """Returns Σ (pixel - s)² of the nearest of listed triangles; pixels begin at (by, by)."""
    x, y = teg.vars("x y")
    i, j, k = map(teg.index, names)
    a, b, c = ((P[F[L[k], n], 0], P[F[L[k], n], 1]) for n in range(3))

    def side(p: Any, q: Any) -> Any:
        return (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])

    sides = [side(b, c), side(c, a), side(a, b)]
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    depth = sum((w * P[F[L[k], n], 2] for n, w in enumerate(sides)), start=0 * x) / area
    colour = s * C[L[k]] + 0.1 * depth
    inside = (area > 0) & (sides[0] > 0) & (sides[1] > 0) & (sides[2] > 0)
    row = i * SIZE + j
    seen = teg.nearest(colour, depth, (k, R[row, 0], R[row, 1]), where=inside, otherwise=0.1)
    pixel = teg.integral(seen, (x, by + j, by + j + 1), (y, by + i, by + i + 1))
    return teg.sum((pixel - s) ** 2, (j, 0, SIZE), (i, 0, SIZE))


def given(seed: int, shift: float = 0.0) -> dict[str, Any]:
    """Returns a few triangles, one without area and one that no list has and whose corners are not there."""
    rng = np.random.default_rng(seed)
    near = np.round(rng.uniform(-1, SIZE + 1, (12, 2)) * 2**30) / 2**30  # which moves exactly
    places = np.concatenate([near + shift, rng.random((12, 1))], axis=1)
    faces = np.array([[0, 1, 2], [3, 4, 5], [2, 4, 6], [7, 7, 8], [99, -5, 99], [9, 10, 11]])
    around = [k for k in range(6) if k != 4]
    lists = [rng.permutation(around)[: rng.integers(0, 6)] for _ in range(SIZE * SIZE)]
    ends = np.cumsum([len(a) for a in lists])
    listed = np.concatenate([*lists, [-1, 77]])  # padding that is not read
    return {
        "P": places,
        "C": rng.random(6),
        "F": faces,
        "L": listed,
        "R": np.stack([np.concatenate([[0], ends[:-1]]), ends], axis=1),
        "s": 0.7,
    }


@pytest.fixture(scope="module")
def plain() -> Any:
    """Returns an evaluator that computes every number where it is used; its programs are made here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(derivation, "with_tables", lambda e: e)
        f = teg.compile(scene(names="uvw"), [P, C, s], backend="numpy")  # no derivation that others share
        f(given(0))
        f.value_and_grad(given(0))
        f.hvp(given(0), along(0))
    assert not any(isinstance(step, Rows) for step in steps(f.program(1).body))
    return f


def along(seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {"P": rng.random((12, 3)), "C": rng.random(6), "s": 1.0}


def close(one: Any, other: Any, tolerance: float = 1e-12) -> bool:
    return bool(np.allclose(one, other, rtol=tolerance, atol=tolerance * np.abs(other).max(), equal_nan=True))


def test_the_normal_form() -> None:
    program = with_sums_of_integers(outlined(scene()))
    changed = with_tables(program)
    (table,) = (n for n in postorder([changed]) if isinstance(n, Table))
    (partition,) = (n for n in postorder([changed]) if isinstance(n, Partition))
    assert table.listed is L
    assert {a.name for a in table.arrays} == {"F", "C"}
    assert len(table.numbers) == 1 + 3 * 3 + 3 + 3 + 2  # is it a triangle, guards, key, colour, an origin
    entries = {n for n in postorder(partition.candidate) if isinstance(n, TableEntry)}
    assert {n.column for n in entries} == set(range(len(table.numbers)))
    assert with_tables(changed) is changed


def test_the_chain_rule_is_applied_once_for_each_row() -> None:
    program = teg.compile(scene(), [P, C], backend="numpy").program(1)
    kinds = [type(step).__name__ for step in program.body]
    assert kinds.index("Blank") < kinds.index("Rows") < kinds.index("Loop") < len(kinds) - 1 - kinds[::-1].index("Loop")
    assert sum(isinstance(step, Blank) for step in steps(program.body)) == 1
    inner = [step for step in steps(program.body) if isinstance(step, Run) and len(step.program.body) > 150]
    assert len(inner) <= 1  # in the loop over rows
    added = len({step.column for step in steps(program.body) if isinstance(step, AddTo)})
    assert 3 * 3 + 3 + 3 <= added <= 1 + 3 * 3 + 3 + 3  # an origin has no derivative


@pytest.mark.usefixtures("x64_for_jax")
@pytest.mark.parametrize("backend", ["c", "numpy", "jax"])
@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_changes(plain: Any, backend: str, seed: int) -> None:
    f = teg.compile(scene(), [P, C, s], backend=backend)
    value, slopes = f.value_and_grad(given(seed))
    exact, expected = plain.value_and_grad(given(seed))
    assert close(value, exact)
    for name, slope in slopes.items():
        assert close(slope, expected[name]), name


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_second_derivatives(plain: Any, backend: str) -> None:
    f = teg.compile(scene(), [P, C, s], backend=backend)
    assert any(isinstance(step, Rows) for step in steps(f.program(1).body))
    found = f.hvp(given(3), along(3))
    for name, slope in plain.hvp(given(3), along(3)).items():
        assert close(found[name], slope, 1e-10), name


def test_the_interpreter(plain: Any) -> None:
    program = teg.compile(scene(), [P, C, s], backend="numpy").program(1)
    known = given(1)
    arrays = [np.asarray(known[a.name]) for a in program.arrays]
    found = interpret_arrays(program, [known[name] for name in program.parameters], arrays)
    assert close(found.outputs[0], plain(known))


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_a_batch_with_lists_of_its_own(plain: Any, backend: str) -> None:
    f = teg.compile(scene(), [P, C, s], backend=backend)
    several = [given(seed) for seed in (4, 5, 6)]
    most = max(len(g["L"]) for g in several)
    batch = {name: np.stack([g[name] for g in several]) for name in ("P", "C", "R", "s")} | {"F": several[0]["F"]}
    batch["L"] = np.stack([np.pad(g["L"], (0, most - len(g["L"])), constant_values=-1) for g in several])
    values, slopes = f.value_and_grad(batch)
    for n, one in enumerate(several):
        value, expected = plain.value_and_grad(one)
        assert close(values[n], value)
        assert close(slopes["P"][n], expected["P"])


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_far_from_the_origin(backend: str) -> None:
    near, far = (teg.compile(scene(by), [P], backend=backend).grad(given(1, by))["P"] for by in (0.0, 65536.0))
    assert close(far, near, 1e-9)  # as far as moved places are the same places


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_rows_that_are_not_there(backend: str) -> None:
    f = teg.compile(scene(), [P], backend=backend)
    wrong = given(1)
    wrong["L"] = wrong["L"].copy()
    wrong["L"][0] = 6
    with pytest.raises(teg.errors.ArrayIndexError, match="index 6 is out of range"):
        f.grad(wrong)
    wrong["L"][0] = 4
    with pytest.raises(teg.errors.ArrayIndexError, match="index -5 is out of range"):
        f.grad(wrong)


def test_threads_give_the_same_bits() -> None:
    one, two = (teg.compile(scene(), [P, C, s], backend="c", threads=n).value_and_grad(given(2)) for n in (1, 2))
    assert one[0] == two[0]
    assert all(np.array_equal(one[1][name], two[1][name]) for name in one[1])


def test_what_costs_little_is_computed_where_it_is_used() -> None:
    x = teg.var("x")
    i, k = teg.index("i"), teg.index("k")
    seen = teg.nearest(C[L[k]], x - C[L[k]], (k, 0, teg.length(L)))
    program = teg.sum(teg.integral(seen, (x, i, i + 1)), (i, 0, 4))
    assert not any(isinstance(n, Table) for n in postorder([with_tables(with_sums_of_integers(outlined(program)))]))


def test_sums_of_one_loop_stay_in_it() -> None:
    """The value, and what the derivative by a parameter has beside the tables, are added up where the derivative by the table is."""
    program = teg.compile(scene(), [P, s], backend="numpy").program(1)
    assert sum(isinstance(step, Cells) for step in steps(program.body)) == 1


def test_explain_names_the_table() -> None:
    rows = [row for row in teg.compile(scene(), [P], backend="numpy").explain().data["loops"]["value"] if row["kept"]]
    assert [(row["index"], row["listed"], row["kept"]) for row in rows] == [("row", "L", 18)]


@pytest.mark.usefixtures("x64_for_jax")
@pytest.mark.parametrize("backend", ["c", "numpy", "jax"])
@pytest.mark.parametrize("faces", [0, 6])
def test_empty_lists(backend: str, faces: int) -> None:
    none = given(1) | {"L": np.zeros(0, dtype=np.int64), "R": np.zeros((SIZE * SIZE, 2), dtype=np.int64)}
    none |= {"F": none["F"][:faces], "C": none["C"][:faces]}
    value, slopes = teg.compile(scene(), [P, C, s], backend=backend).value_and_grad(none)
    assert value == pytest.approx(SIZE**2 * (0.1 - 0.7) ** 2, rel=1e-13)
    assert slopes["s"] == pytest.approx(-2 * SIZE**2 * (0.1 - 0.7), rel=1e-13)
    assert not slopes["P"].any()
    assert slopes["C"].shape == (faces,)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_weights_that_are_tiny_or_not_a_number(plain: Any, backend: str) -> None:
    """What decides whether a row matters may neither underflow nor hide that a weight is not a number."""
    w = teg.param("w")
    f = teg.compile(w * scene(), [P, C], backend=backend)
    exact = plain.grad(given(1))
    for name, slope in f.grad(given(1) | {"w": 1e-200}).items():
        assert close(np.asarray(slope) * 1e200, exact[name]), name
    lost = f.grad(given(1) | {"w": math.nan})
    assert np.isnan(lost["C"][exact["C"] != 0.0]).all()
