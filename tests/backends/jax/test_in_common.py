"""Searches that flags have in common with the body of their integral: which are found, and values that stay the same."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from teg.backends.jax.in_common import in_common
from teg.backends.jax.kernel import compile_jax
from teg.backends.jax.printer import kernel_lines
from teg.backends.numpy.kernel import compile_numpy
from teg.program import Adaptive, Bend, Gauss, Integrate, Isolate, Program, Rule, Stmt, assigned, statements
from teg.program.fields import renamed
from tests.backends.isolate_surfaces import cubic, isolate
from tests.backends.programs import let, program

pytest.importorskip("jax")


def search(suffix: str, factor: Any = "p0") -> tuple[Stmt, ...]:
    """√(factor·x9), as the root of x³ - factor·x9·x; all names end in `suffix`."""
    block = (let("vc", "mul", factor, "x9"), isolate("vr", cubic("vc"), 0.25, 4.0))
    own = {name for s in statements(block) for name in (*assigned(s), "x0", "x0l", "x0r")}
    return tuple(renamed(s, {name: name + suffix for name in own}) for s in block)


TIGHT = Adaptive(1e-12)


def integral(flags: tuple[Stmt, ...], rule: Rule = TIGHT, **options: Any) -> Integrate:
    """∫ (√(p0·x9), twice where the flag b0 holds) dx9 from ½ to 2, with a break at 1."""
    body = (*search("b"), let("v1", "mul", 2.0, "vrb"), let("v2", "select", "b0", "v1", "vrb"))
    whole = Integrate("x9", 0.5, 2.0, (1.0,), flags, None, body, ("v2",), ("v3",), rule)
    return replace(whole, **options)


def flags(suffix: str, factor: Any = "p0") -> tuple[Stmt, ...]:
    """b0: √(factor·x9) < 1."""
    return (*search(suffix, factor), let("v0", "sub", f"vr{suffix}", 1.0), let("b0", "lt0", "v0"))


def searches(p: Program) -> int:
    return sum("roots.isolate(" in line for line in kernel_lines(p))


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("rule", [TIGHT, Gauss(16)], ids=["adaptive", "fixed"])
def test_a_search_of_flags_and_body_stands_once(rule: Rule) -> None:
    p = program(1, (integral(flags("f"), rule),), "v3")
    assert searches(p) == 1
    found = compile_jax(p)([np.array([1.0])], 1)
    exact = 2 / 3 * (2 * (1 - 0.5**1.5) + 2**1.5 - 1)
    np.testing.assert_allclose(found, [[exact]], rtol=1e-11)
    at = [np.array([0.6, 1.0, 1.7])]
    np.testing.assert_allclose(compile_jax(p)(at, 3), compile_numpy(p)(at, 3), rtol=1e-13)


def test_what_only_one_of_them_needs_stays_there() -> None:
    common = in_common(integral(flags("f")))
    assert common is not None
    assert [type(s) is Isolate for s in common.block] == [False, True]
    assert (common.names, common.names_in_body, common.flagged) == (("vrf",), ("vrb",), ("b0",))
    assert [assigned(s) for s in (*common.flags, *common.body)] == [("v0",), ("b0",), ("v1",), ("v2",)]


@pytest.mark.usefixtures("x64")
def test_values_of_flags_that_the_body_reads_are_those_in_the_middle() -> None:
    whole = integral(flags("f"))
    body = (*whole.body, let("v4", "add", "v2", "vrf"))
    p = program(1, (replace(whole, body=body, values=("v4",)),), "v3")
    at = [np.array([0.6, 1.3])]
    assert searches(p) == 1
    np.testing.assert_allclose(compile_jax(p)(at, 2), compile_numpy(p)(at, 2), rtol=1e-13)


def with_a_flag_in_the_search() -> Integrate:
    """The same, where both searches are those of p0·x9 or, where the flag b7 of the middle holds, of 2·p0·x9."""
    chosen = let("v7", "select", "b7", 2.0, 1.0), let("v8", "mul", "v7", "p0")
    whole = integral((let("v6", "sub", "x9", 1.0), let("b7", "gt0", "v6"), *chosen, *flags("f", factor="v8")))
    return replace(whole, body=(*chosen_again(chosen), *(renamed(s, {"p0": "v8b"}) for s in whole.body)))


def chosen_again(block: tuple[Stmt, ...]) -> tuple[Stmt, ...]:
    return tuple(renamed(s, {"v7": "v7b", "v8": "v8b"}) for s in block)


@pytest.mark.usefixtures("x64")
def test_a_search_may_need_flags_that_need_no_search() -> None:
    whole = with_a_flag_in_the_search()
    common = in_common(whole)
    assert common is not None
    assert common.known == ("b7",)
    assert [assigned(s) for s in common.early] == [("v6",), ("b7",)]
    p = program(1, (whole,), "v3")
    assert searches(p) == 1
    at = [np.array([0.3, 0.45, 0.8])]
    np.testing.assert_allclose(compile_jax(p)(at, 3), compile_numpy(p)(at, 3), rtol=1e-13)


def test_a_search_that_needs_flags_of_another_search_stands_twice() -> None:
    whole = with_a_flag_in_the_search()
    late = (let("v6", "sub", "vrg", 1.0), *whole.flags[1:])
    assert in_common(replace(whole, flags=(*search("g"), *late))) is None


@pytest.mark.parametrize(
    "whole",
    [
        integral(flags("f", factor=2.0)),
        integral(flags("f"), need="b0"),
        integral(flags("f"), bends=(Bend("root", (0.0, 1.0, 0.0)),)),
        integral((let("b0", "lt0", "p0"),)),
    ],
    ids=["another search", "a need", "a bend", "no search"],
)
def test_nothing_is_in_common(whole: Integrate) -> None:
    assert in_common(whole) is None
