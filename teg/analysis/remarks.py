"""Remarks: what a pass decided and why, recorded where it decides. Reports print them.

A pass that decides something takes a `Remarks` and adds to it; what nobody reads costs a few tuples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from teg.ir.expr import Expr


@dataclass(frozen=True)
class Remark:
    """One decision: the pass, the surface g or the integral it is about, what was chosen, and the reason."""

    stage: str
    subject: Expr
    choice: str
    reason: str


class Remarks:
    """The remarks of one run of the passes, each once, in the order in which they were made."""

    def __init__(self) -> None:
        self._made: dict[Remark, None] = {}

    def add(self, stage: str, subject: Expr, choice: str, reason: str) -> None:
        """Records a decision."""
        self._made[Remark(stage, subject, choice, reason)] = None

    def __iter__(self) -> Iterator[Remark]:
        return iter(self._made)
