"""The quick run: programs of the first seeds, with references that were kept, in NumPy and C; JAX sees some of them.

`make fuzz N=5000` computes references as it goes and minimises failures. A program of `OPEN` is a known fault: the run prints the list.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.answer import answer
from tests.fuzz.generate import program as of_seed
from tests.fuzz.judge import Judgement, agreement, digest, judge, stored_references
from tests.fuzz.open_faults import OPEN
from tests.fuzz.reference import NoReferenceError
from tests.fuzz.syntax import Program, as_python, bracket, call, integral, parameter, size, variable, where

PROGRAMS = 300
CHUNK = 10
FOLDER = Path(__file__).parent
LIMIT = 20.0
IN_C, IN_JAX = 4, 100
"""Every how many programs are compiled by these: gcc takes half a second for one, XLA some seconds. The long run sees all in C."""

x, y, t, a = variable("x"), variable("y"), parameter("t"), parameter("a")


@pytest.fixture(scope="module")
def references() -> dict[str, object]:
    return dict(stored_references(FOLDER / "references.jsonl"))


def judged(program: Program, references: dict[str, object], backend: str) -> Judgement | None:
    known = references.get(digest(program))
    assert known is not None, "the generator has changed: python -m tests.fuzz.run --references -n 300 -o tests/fuzz"
    if isinstance(known, str):
        return agreement(program, backend, LIMIT) if program.law else None
    return judge(program, known, backend, LIMIT)  # type: ignore[arg-type]


def check(seeds: range, references: dict[str, object], backend: str) -> None:
    failures = []
    for seed in seeds:
        program = of_seed(seed)
        judgement = judged(program, references, backend)
        if judgement is not None and judgement.verdict in ("wrong", "crash") and seed not in OPEN:
            failures.append(as_python(program, backend, (f"seed {seed}: {judgement.verdict}: {judgement.what}",)))
    assert not failures, "\n\n".join(failures)


@pytest.mark.parametrize("first", range(0, PROGRAMS, CHUNK))
def test_numpy(first: int, references: dict[str, object]) -> None:
    check(range(first, first + CHUNK), references, "numpy")


@pytest.mark.parametrize("first", range(0, PROGRAMS, CHUNK))
def test_c(first: int, references: dict[str, object]) -> None:
    check(range(first, first + CHUNK, IN_C), references, "c")


@pytest.mark.parametrize("first", range(0, PROGRAMS, IN_JAX))
def test_jax(first: int, references: dict[str, object]) -> None:
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    try:
        check(range(first, first + 1), references, "jax")
    finally:
        jax.config.update("jax_enable_x64", before)


# -- the fuzz itself --------------------------------------------------------------------------------------------------------


def made(tree: object, **values: float) -> Program:
    return Program("test", tree, dict(values))  # type: ignore[arg-type]


CLOSED = {
    "half": (made(integral(bracket(x < t) * call("exp", a * x), ("x", 0, 1)), t=0.5, a=0.7), (np.exp(0.35) - 1) / 0.7),
    "disk": (made(integral(bracket(x * x + y * y < t * t), ("x", -1, 1), ("y", -1, 1)), t=0.5), np.pi / 4),
    "peak": (made(integral(1 / call("cosh", 3e4 * (x - t)) ** 2, ("x", 0, 1)), t=0.3), 2 / 3e4),
    "pole": (made(integral(where(x > t, (x - t) ** -0.7, 0.0), ("x", 0, 1)), t=0.3), 0.7**0.3 / 0.3),
    "boundary layer": (made(integral(call("exp", -2e4 * x), ("x", 0, 1))), 1 / 2e4),
    "triangle": (made(integral(bracket(y < t * x), ("x", 0, 1), ("y", 0, 1)), t=0.5), 0.25),
}


@pytest.mark.parametrize("name", CLOSED)
def test_the_reference_knows_closed_forms(name: str) -> None:
    program, exact = CLOSED[name]
    assert abs(answer(program).value - exact) <= 1e-13 * abs(exact)


def test_the_reference_knows_derivatives() -> None:
    program, _ = CLOSED["disk"]
    known = answer(program)
    assert known.slope is not None
    assert abs(known.slope - np.pi * known.direction["t"]) < 1e-12


def test_a_reference_that_does_not_converge_is_none() -> None:
    with pytest.raises(NoReferenceError):
        answer(made(integral(1 / (x - t), ("x", 0, 1)), t=0.3))


def test_programs_are_the_same_for_the_same_seed() -> None:
    assert [digest(of_seed(s)) for s in range(20)] == [digest(of_seed(s)) for s in range(20)]


def test_programs_run_as_text(capsys: pytest.CaptureFixture[str]) -> None:
    program, exact = CLOSED["half"]
    exec(as_python(program), {})
    assert capsys.readouterr().out.startswith(f"({exact:.6f}"[:6])


def test_failures_become_small() -> None:
    from tests.fuzz.minimise import minimised

    tree = integral(bracket(x < t) * call("exp", a * x) + call("sin", x) ** 2 * bracket(x * a < 1), ("x", 0, 1))
    small = minimised(made(tree, t=0.5, a=0.7), lambda p: any(n.data == "exp" for n in _nodes(p)))
    assert size(small.tree) <= 6


def _nodes(program: Program) -> list[object]:
    from tests.fuzz.syntax import walk

    return list(walk(program.tree))


def test_wrong_answers_are_seen() -> None:
    """A judge that is told another truth."""
    program, _ = CLOSED["half"]
    other, _ = CLOSED["triangle"]
    assert judge(program, answer(program), "numpy").verdict == "right"
    assert judge(other, answer(made(integral(bracket(y < t * x), ("x", 0, 1), ("y", 0, 1)), t=0.5000001)), "numpy").verdict == "wrong"
