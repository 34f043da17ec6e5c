"""Residues of flat programs: equal rational functions have equal ones, other values have none."""

from __future__ import annotations

import pytest

from teg.program import Assign
from teg.program.residues import Residues, random_residue, residue_of


def residues(*body: Assign) -> Residues:
    made = Residues({"p0": random_residue(0), "p1": random_residue(1)})
    made.follow(body)
    return made


def test_equal_rational_functions_have_equal_residues() -> None:
    found = residues(
        Assign("v0", "add", ("p0", "p1")),
        Assign("v1", "powi", ("v0", 2)),
        Assign("v2", "mul", ("p0", "p0")),
        Assign("v3", "mul", (2.0, "p0", "p1")),
        Assign("v4", "powi", ("p1", 2)),
        Assign("v5", "add", ("v2", "v3", "v4")),
        Assign("v6", "div", ("v5", "v0")),
        Assign("v7", "sub", ("v6", "v0")),
        Assign("v8", "powi", ("v0", -1)),
        Assign("v9", "mul", ("v8", "v1")),
    )
    assert found.of("v1") == found.of("v5") != found.of("v2")
    assert found.of("v6") == found.of("v0") == found.of("v9")
    assert found.of("v7") == 0
    assert residue_of(0.5) != residue_of(0.5 * 2.0**61)


@pytest.mark.parametrize(
    "body", [Assign("v0", "exp", ("p0",)), Assign("v0", "div", ("p0", 0.0)), Assign("v0", "add", ("p0", float("nan")))]
)
def test_what_is_no_rational_number_has_none(body: Assign) -> None:
    found = residues(body, Assign("v1", "add", ("v0", "p1")), Assign("v2", "mul", (0.0, "v1")))
    assert found.of("v0") is None
    assert found.of("v1") is None
    assert found.of("v2") is None


def test_selections_follow_conditions_that_are_known() -> None:
    body = (
        Assign("b0", "le0", ("p0",)),
        Assign("b1", "not", ("b0",)),
        Assign("b2", "gt0", ("p1",)),
        Assign("b3", "or", ("b1", "b2")),
        Assign("v0", "select", ("b1", "p1", 0.0)),
        Assign("v1", "select", ("b2", "p1", 0.0)),
        Assign("v2", "select", ("b2", "p0", "p0")),
    )
    found = Residues({"p0": random_residue(0), "p1": random_residue(1)})
    found.assume_positive(random_residue(0))
    found.follow(body)
    assert (found.truth("b0"), found.truth("b1"), found.truth("b2"), found.truth("b3")) == (False, True, None, True)
    assert found.of("v0") == random_residue(1)
    assert found.of("v1") is None
    assert found.of("v2") == random_residue(0)
