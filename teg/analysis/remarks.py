"""Remarks: the decisions of passes and their reasons, recorded where they are taken. Reports print them.

A pass that decides takes a `Remarks` and adds to it. Unread remarks cost a few tuples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from teg.ir.expr import Expr


@dataclass(frozen=True)
class Remark:
    """One decision: the pass, the surface g or the integral concerned, the choice, and the reason."""

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
