"""Flat programs that wait for a sum over gaps: those that nothing else reads."""

from __future__ import annotations

from dataclasses import replace

from teg.backends.c.delayed import delayed, readers_of
from teg.program import Assign, Program
from teg.program.arrays import ArrayProgram, Gaps, Run

DOUBLE = Program(("x",), (Assign("v0", "mul", (2.0, "p0")),), ("v0",))
FIRST, SECOND, THIRD, END = (Run(DOUBLE, ("v1",), (name,)) for name in ("v2", "v3", "v4", "v5"))
INSIDE = Run(DOUBLE, ("v3",), ("v7",))
GAPS = Gaps("i1", 0, 3, (), ("v3", 0.0, 0.0), ("v9",), "j", -1, 0.0, "v5", "v10", "v11", (INSIDE,), ("v7",))


def waiting(*block: Run | Gaps, outputs: tuple[str, ...] = ("v9",)) -> list[Run]:
    program = ArrayProgram((), (), block, outputs)
    return delayed(block, readers_of(program))[id(block[-1])]


def test_what_only_gaps_read_waits_for_them() -> None:
    before = replace(SECOND, inputs=("v2",))  # reads what the first one computes
    assert waiting(FIRST, before, GAPS) == [FIRST, before]


def test_what_others_read_does_not_wait() -> None:
    assert waiting(SECOND, END, GAPS) == [SECOND]  # the line ends at v5
    assert waiting(SECOND, GAPS, outputs=("v9", "v3")) == []
    assert waiting(THIRD, SECOND, replace(GAPS, lo="v4")) == [SECOND]
