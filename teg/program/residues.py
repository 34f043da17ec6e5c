"""Values of a program in the prime field GF(P) at one random point: equal rational functions have equal residues.

A name whose value is no rational function of the inputs, or one that is divided by 0 here, has none. Two different rational functions
of degree d have the same residue with a chance of 2d/P at most (lemma of Schwartz and Zippel).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from hashlib import blake2b
from math import isfinite, prod

from teg.program.names import is_condition
from teg.program.statements import Arg, Assign, Stmt

P = 2**63 - 25
"""The largest prime below 2⁶³. (Modulo a Mersenne prime, powers of 2 would be few.)"""


def random_residue(*key: object) -> int:
    """Returns the residue that stands for an unknown number; the same for the same key."""
    return int.from_bytes(blake2b(repr(key).encode(), digest_size=16).digest(), "big") % P


def residue_of(number: float) -> int | None:
    """Returns the residue of a number that is finite."""
    if not isfinite(number):
        return None
    fraction = Fraction(number)
    return fraction.numerator * pow(fraction.denominator, -1, P) % P


class Residues:
    """The residues of names: of inputs as given, of assignments as far as they are followed. A selection has one where its condition is
    known, or both branches have the same; conditions are known of numbers that are assumed to be positive."""

    def __init__(self, known: Mapping[str, int | None]) -> None:
        self._known: dict[str, int | None] = dict(known)
        self._holds: dict[Arg, bool | None] = {}
        self._positive: set[int] = set()

    def of(self, arg: Arg) -> int | None:
        """Returns the residue of a name or a literal, if it has one."""
        return self._known.get(arg) if isinstance(arg, str) else residue_of(float(arg))

    def truth(self, condition: Arg) -> bool | None:
        """Returns whether a condition holds, if that is known."""
        return condition if isinstance(condition, bool) else self._holds.get(condition)

    def assume_positive(self, residue: int) -> None:
        """Takes numbers with a residue to be positive in what is followed from now on."""
        self._positive.add(residue)

    def follow(self, block: Iterable[Stmt]) -> None:
        """Computes the assignments of a block."""
        for s in block:
            if not isinstance(s, Assign):
                continue
            if is_condition(s.name):
                self._holds[s.name] = self._decided(s)
            elif s.op == "select":
                condition, *branches = s.args
                then, otherwise = map(self.of, branches)
                holds = self.truth(condition)
                same = then if then == otherwise else None
                self._known[s.name] = same if holds is None else then if holds else otherwise
            else:
                meaning = MEANINGS.get(s.op)
                args = [self.of(a) for a in s.args]
                self._known[s.name] = None if meaning is None else meaning([a for a in args if a is not None], len(args))

    def _decided(self, s: Assign) -> bool | None:
        """Returns whether a condition holds, as far as it is known."""
        if s.op in ("gt0", "ge0", "lt0", "le0"):
            residue = self.of(s.args[0])
            if residue is None or (residue not in self._positive and -residue % P not in self._positive):
                return None
            return (residue in self._positive) == (s.op in ("gt0", "ge0"))
        holds = [self.truth(a) for a in s.args]
        if s.op == "not":
            return None if holds[0] is None else not holds[0]
        if s.op in ("and", "or"):
            decisive = s.op == "or"
            return decisive if decisive in holds else None if None in holds else not decisive
        return None


def _divided(args: list[int], count: int) -> int | None:
    return args[0] * pow(args[1], -1, P) % P if len(args) == count and args[1] else None


def _power(args: list[int], count: int) -> int | None:
    if len(args) < count:
        return None
    exponent = args[1] if args[1] <= P // 2 else args[1] - P
    return pow(args[0], exponent, P) if args[0] or exponent >= 0 else None


def _whole(of: Callable[[list[int]], int]) -> Callable[[list[int], int], int | None]:
    """Returns an operation that has a residue where all operands have one."""
    return lambda args, count: of(args) % P if len(args) == count else None


MEANINGS: dict[str, Callable[[list[int], int], int | None]] = {
    "const": _whole(lambda a: a[0]),
    "add": _whole(sum),
    "sub": _whole(lambda a: a[0] - a[1]),
    "mul": _whole(prod),
    "neg": _whole(lambda a: -a[0]),
    "div": _divided,
    "powi": _power,
}
