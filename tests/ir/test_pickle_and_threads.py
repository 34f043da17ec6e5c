"""Pickling, depth, and interning from many threads."""

from __future__ import annotations

import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

import teg
from teg.ir.node import digest
from tests.references import REFERENCES, Reference

DEPTH = 100_000


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda r: r.id)
def test_a_pickled_program_is_the_same_object(reference: Reference) -> None:
    e = reference.build()
    assert pickle.loads(pickle.dumps(e)) is e


def test_a_pickled_condition_is_the_same_object() -> None:
    x, t = teg.var("x"), teg.param("t")
    c = (x < t) & ~(x < 0.5) | (x > 2 * t)
    assert pickle.loads(pickle.dumps(c)) is c


def chain(depth: int, name: str = "x") -> teg.Expr:
    e: teg.Expr = teg.var(name)
    for i in range(depth):
        e = teg.sin(e) if i % 2 else e * 0.5
    return e


@pytest.mark.slow
def test_a_chain_of_100_000_nodes() -> None:
    e = chain(DEPTH)
    assert teg.size(e) == DEPTH + 2  # each level, the variable, the number ½
    assert str(e)
    assert repr(e)
    assert teg.dump(e).count("\n") > DEPTH / 2
    assert e.free == {teg.var("x")}
    assert pickle.loads(pickle.dumps(e)) is e
    assert isinstance(digest(e), int)


@pytest.mark.slow
def test_a_deep_sum_evaluates_and_differentiates() -> None:
    t = teg.param("t")
    e: teg.Expr = t
    for _ in range(20_000):
        e = teg.sin(e)
    f = teg.compile(e, [t])
    value, gradient = f.value_and_grad(t=0.5)
    assert 0 < value < 0.5
    assert 0 < gradient["t"] < 1


def test_a_deep_expression_can_be_forgotten() -> None:
    e = chain(DEPTH, "unique_to_this_test")
    del e  # no recursion in the destructor either


def test_eight_threads_make_the_same_objects() -> None:
    def build(_: int) -> list[teg.Expr]:
        x, t = teg.var("x"), teg.param("t")
        return [teg.integral(teg.bracket(x < t + i / 7) * teg.exp(x * i), (x, 0, 1)) for i in range(300)]

    with ThreadPoolExecutor(8) as pool:
        results = list(pool.map(build, range(8)))
    assert all(a is b for row in results[1:] for a, b in zip(results[0], row, strict=True))


def test_one_evaluator_from_eight_threads() -> None:
    x, t = teg.var("x"), teg.param("t")
    f = teg.compile(teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), [t])
    with ThreadPoolExecutor(8) as pool:
        results = list(pool.map(lambda i: f.value_and_grad(t=i / 100), range(1, 99)))
    for i, (value, gradient) in zip(range(1, 99), results, strict=True):
        assert value == pytest.approx((i / 100) ** 2 / 2, rel=1e-13)
        assert gradient["t"] == pytest.approx(i / 100, rel=1e-13)


def test_the_digest_is_the_same_in_every_process() -> None:
    x, t = teg.var("x"), teg.param("t")
    e = teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, 1))
    program = (
        "import teg; from teg.ir.node import digest; x, t = teg.var('x'), teg.param('t');"
        "print(digest(teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, 1))))"
    )
    for _ in range(2):
        found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
        assert int(found) == digest(e)
