"""Rounding errors of the numbers that intrinsics clip by and integrate.

    |fl(u ∘ v) - u ∘ v| <= ½ε·|u ∘ v|        |fl(Σ uᵢ) - Σ uᵢ| <= ½ε·(n - 1)·Σ|uᵢ|

The offset of a line far from the origin is a small difference of large numbers, c + a·l + b·m at the corner (l, m) of a box: there the
domain is off by the roundings of these, however exact its moments are (running error analysis: Wilkinson, Rounding Errors in Algebraic
Processes, 1963). Conditions are taken as they are decided. Linear in the size of the program; only the numbers that an intrinsic depends
on by assignments have companions.
"""

from __future__ import annotations

from teg.passes.intrinsics import STATEMENTS
from teg.passes.program.propagation import Propagation
from teg.program import Arg, Assign, Program, Stmt, statements
from teg.program.names import is_condition

UNIT = 2.0**-53
"""The largest rounding error of an operation, relative to its result."""
EXACT = ("neg", "abs", "min", "max", "select", "const", "floor")
"""Operations that round nothing."""


class Roundings:
    """Rounding errors of the numbers of a program that its intrinsics depend on."""

    def __init__(self, program: Program, carried: Propagation) -> None:
        self._carried = carried
        self._needed = _needed(program)

    def of(self, arg: Arg) -> Arg:
        """Returns the rounding error of a number; 0.0 if it is exact, or no intrinsic depends on it."""
        return self._carried.error(arg)

    def append(self, stmt: Assign, out: list[Stmt]) -> None:
        """Appends the rounding error of an assignment: its own, and those of its arguments."""
        if stmt.name not in self._needed:
            return
        self._carried.carry(stmt, out)
        total = self._carried.sum_of((self._carried.error(stmt.name), self._own(stmt, out)), out)
        if total != 0.0:
            self._carried.errors[stmt.name] = total

    def _own(self, stmt: Assign, out: list[Stmt]) -> Arg:
        """Returns the rounding of one operation."""
        op, args, put = stmt.op, stmt.args, self._carried.op
        if op in EXACT:
            return 0.0
        if op == "add" and len(args) > 2:
            sizes = [abs(a) if isinstance(a, float) else put(out, "abs", a) for a in args]
            return put(out, "mul", UNIT * (len(args) - 1), put(out, "add", *sizes))
        weight = UNIT if op in ("add", "sub", "div", "sqrt") else UNIT * (len(args) - 1) if op == "mul" else 2.0 * UNIT
        if op == "powi":
            weight = UNIT * max(1.0, abs(float(args[1])))
        return put(out, "mul", weight, put(out, "abs", stmt.name))


def _needed(program: Program) -> set[str]:
    """Returns the names of the numbers that intrinsics depend on by assignments."""
    made = {s.name: s for s in statements(program.body) if isinstance(s, Assign)}
    stack = [a for s in statements(program.body) if type(s) in STATEMENTS for a in STATEMENTS[type(s)].numbers(s)]
    needed: set[str] = set()
    while stack:
        name = stack.pop()
        if isinstance(name, str) and name in made and name not in needed and not is_condition(name):
            needed.add(name)
            stack.extend(made[name].args)
    return needed
