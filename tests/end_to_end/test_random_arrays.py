"""Random programs with arrays against the same programs with every sum written out and every entry a parameter of its own."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import NoReparameterisationError
from teg.ir.expr import Expr
from teg.ir.operands import as_number

ROWS, FACES = 4, 3
X, T = teg.var("x"), teg.param("t")
V, F = teg.array("V", 2), teg.indices("F", 2)
Build = Callable[[Any, Mapping[str, Any]], Any]
"""A subprogram, given what writes it and the indices of the sums around it."""


class WithArrays:
    """Writes a program with arrays."""

    lengths: Mapping[str, Any] = {"v": teg.length(V, 0), "f": teg.length(F, 0)}

    def entry(self, row: Any, column: int) -> Any:
        return V[row, column]

    def face(self, k: Any, column: int) -> Any:
        return F[k, column]

    def sum(self, kind: str, name: str, body: Callable[[Any], Any]) -> Expr:
        k = teg.index(name)
        return teg.sum(body(k), (k, 0, self.lengths[kind]))


class WrittenOut:
    """Writes the same program without arrays, for given faces."""

    def __init__(self, faces: np.ndarray) -> None:
        self.faces = faces

    def entry(self, row: Any, column: int) -> Any:
        return teg.param(f"V{int(row)}{column}")

    def face(self, k: Any, column: int) -> Any:
        return int(self.faces[k, column])

    def sum(self, kind: str, name: str, body: Callable[[Any], Any]) -> Expr:
        return sum((as_number(body(k)) for k in range(ROWS if kind == "v" else FACES)), start=as_number(0))


def random_program(rng: random.Random) -> Build:
    """Sums up to two deep, around and inside an integral; conditions, functions, products; entries by sums' indices and by faces."""

    def leaf(sums: tuple[str, ...], inside: bool) -> Build:
        choice, column = rng.random(), rng.randrange(2)
        rows, faces = [k for k in sums if k[0] == "v"], [k for k in sums if k[0] == "f"]
        if choice < 0.2:
            return lambda write, at: T
        if inside and choice < 0.45:
            return lambda write, at: X
        if sums and choice < 0.55:
            k = rng.choice(sums)
            return lambda write, at: at[k] * 0.5 + 0.25
        if faces and choice < 0.75:
            k, corner = rng.choice(faces), rng.randrange(2)
            return lambda write, at: write.entry(write.face(at[k], corner), column)
        if rows:
            k = rng.choice(rows)
            return lambda write, at: write.entry(at[k], column)
        row = rng.randrange(ROWS)
        return lambda write, at: write.entry(row, column)

    def some(sums: tuple[str, ...], depth: int, inside: bool) -> Build:
        choice = rng.random() if depth else 1.0
        if choice < 0.22:
            a, b = some(sums, depth - 1, inside), some(sums, depth - 1, inside)
            return lambda write, at: a(write, at) + b(write, at)
        if choice < 0.42:
            a, b = some(sums, depth - 1, inside), some(sums, depth - 1, inside)
            return lambda write, at: a(write, at) * b(write, at)
        if choice < 0.52:
            a = some(sums, depth - 1, inside)
            return lambda write, at: teg.sin(a(write, at))
        if choice < 0.6:
            a, b, c = some(sums, depth - 1, False), some(sums, depth - 1, False), some(sums, depth - 1, inside)
            return lambda write, at: teg.where(as_number(a(write, at)) < b(write, at), c(write, at), a(write, at))
        if choice < 0.82 and len(sums) < 2:
            kind = rng.choice("vf")
            name = f"{kind}{len(sums)}"
            body = some((*sums, name), depth - 1, inside)
            return lambda write, at: write.sum(kind, name, lambda k: body(write, {**at, name: k}))
        if choice < 1.0 and not inside:
            body, bound = some(sums, depth - 1, True), some(sums, min(depth - 1, 1), False)
            curved = rng.random() < 0.5
            return lambda write, at: teg.integral(teg.where((X * X if curved else X) < bound(write, at), body(write, at), 0), (X, 0, 1))
        return leaf(sums, inside)

    return some((), 4, False)


@pytest.mark.parametrize("seed", [*range(5), 102, *(pytest.param(s, marks=pytest.mark.slow) for s in range(5, 45))])
def test_sums_are_what_they_are_written_out(seed: int) -> None:
    build, numbers = random_program(random.Random(seed)), np.random.default_rng(seed)
    v, faces, t = numbers.uniform(0.1, 0.9, (ROWS, 2)), numbers.integers(0, ROWS, (FACES, 2)), float(numbers.uniform(0.2, 0.9))
    along, step = numbers.normal(size=(ROWS, 2)), 0.3
    with_arrays, written_out = (as_number(build(w, {})) for w in (WithArrays(), WrittenOut(faces)))
    names = {(i, c): f"V{i}{c}" for i in range(ROWS) for c in range(2)}
    plain = teg.compile(written_out, [*(teg.param(n) for n in names.values()), T], backend="c", inaccurate="ignore")
    given = {**{n: v[place] for place, n in names.items()}, "t": t}
    value, slopes = plain.value_and_grad(given)

    def as_array(found: Mapping[str, Any]) -> np.ndarray:
        return np.array([found[names[i, c]] for i in range(ROWS) for c in range(2)]).reshape(ROWS, 2)

    for backend in ("numpy", "c"):
        f = teg.compile(with_arrays, [V, T], backend=backend, inaccurate="ignore")
        values = {name: {"V": v, "F": faces, "t": t}[name] for name in f.parameters}
        found, by_array = f.value_and_grad(values)
        assert found == pytest.approx(value, rel=1e-10, abs=1e-11, nan_ok=True)
        np.testing.assert_allclose(by_array["V"], as_array(slopes), rtol=1e-9, atol=1e-9 * (1 + np.nanmax(np.abs(as_array(slopes)))))
        assert by_array["t"] == pytest.approx(slopes["t"], rel=1e-9, abs=1e-9, nan_ok=True)
    try:
        expected = as_array(plain.hvp(given, {**{n: along[place] for place, n in names.items()}, "t": step}))
    except NoReparameterisationError:
        return
    product = f.hvp(values, {"V": along, "t": step})["V"]
    np.testing.assert_allclose(product, expected, rtol=1e-7, atol=1e-7 * (1 + np.nanmax(np.abs(expected))))
