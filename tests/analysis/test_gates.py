"""What must hold for atoms of a condition to matter, and on which side of them it holds."""

from __future__ import annotations

from typing import cast

import teg
from teg.analysis.gates import gates_of
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import FALSE, TRUE, Cond
from teg.ir.simplify import conjunction, disjunction, negation

x, y = teg.vars("x y")
a, b = teg.params("a b")
ATOM = cast(Cond, x < a)
GATE, OTHER = cast(Cond, a > b), cast(Cond, b > 2)


def gates(condition: Cond) -> tuple[Cond, Cond]:
    return gates_of(condition, atoms_of(ATOM))


def test_what_is_free_of_variables_is_a_gate() -> None:
    assert gates(ATOM) == (TRUE, FALSE)
    assert gates(negation(ATOM)) == (FALSE, TRUE)
    assert gates(conjunction(GATE, ATOM)) == (GATE, FALSE)
    assert gates(conjunction(cast(Cond, y > b), ATOM)) == (TRUE, FALSE)  # y > b holds at some places
    assert gates(disjunction(GATE, ATOM)) == (negation(GATE), FALSE)
    assert gates(negation(disjunction(GATE, ATOM))) == (FALSE, negation(GATE))
    assert gates(cast(Cond, y > b)) == (FALSE, FALSE)


def test_an_atom_on_both_sides() -> None:
    either = disjunction(conjunction(GATE, ATOM), conjunction(negation(GATE), OTHER, negation(ATOM)))
    upright, turned = gates(either)
    assert upright is GATE
    assert turned is conjunction(negation(GATE), OTHER)
    assert conjunction(upright, turned) is FALSE
