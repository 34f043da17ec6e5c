"""Flat programs as text: a statement a line, the inside of blocks indented."""

from __future__ import annotations

import teg
from teg.analysis.settings import Integration
from teg.pipeline import flat_program
from teg.program.show import listing

x = teg.var("x")
t = teg.param("t")


def test_a_statement_a_line() -> None:
    text = listing(flat_program([teg.exp(t) + 1], ["t"], Integration()))
    assert text.splitlines() == ["p0 = 't'", "v1 = exp(p0)", "v2 = add(v1, 1.0)", "outputs v2"]


def test_blocks_are_indented() -> None:
    lines = listing(flat_program([teg.integral(teg.exp(x * t), (x, 0, 1))], ["t"], Integration(rule="gauss", order=3))).splitlines()
    assert any(line.startswith("v") and "= Integrate(" in line for line in lines)
    assert any(line.startswith("    ") and "= exp(" in line for line in lines)
