"""Values of a flat program in a loop as polynomials, with coefficients that the loop does not change.

Coefficient     a number of the flat program, with its residues: whether it is 0 is decided in a finite field
Steady          arithmetic with coefficients, as assignments
Polynomials     the polynomials of values: in inputs that the loop changes, and in the variables of a polygon
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import count
from typing import NamedTuple

from teg.program import Arg, Assign, Stmt
from teg.program.names import is_number
from teg.program.residues import P, Residues, random_residue, residue_of

POINTS = 2
"""Random points at which a coefficient that is 0 must be 0."""
MOST_TERMS, MOST_DEGREE = 120, 8
"""Monomials of a polynomial, and their degree, beyond which it is a number like others."""
Monomial = tuple[tuple[str, int], ...]
"""Exponents by variable, the variables in order."""
ONE: Monomial = ()


class Coefficient(NamedTuple):
    """A number that the loop does not change, and its residues at the random points."""

    arg: Arg
    residues: tuple[int, ...]


Poly = dict[Monomial, Coefficient]


class Steady:
    """Arithmetic with coefficients, as assignments; the same one is written once."""

    def __init__(self, numbers: count[int]) -> None:
        self.lines: list[Assign] = []
        self._numbers = numbers
        self._known: dict[tuple[str, tuple[Arg, ...]], str] = {}

    def number(self, value: float) -> Coefficient:
        """Returns a literal, which is finite."""
        residue = residue_of(value)
        assert residue is not None
        return Coefficient(value, (residue,) * POINTS)

    def _put(self, op: str, *args: Arg) -> str:
        if (op, args) not in self._known:
            self._known[op, args] = f"v{next(self._numbers)}"
            self.lines.append(Assign(self._known[op, args], op, args))
        return self._known[op, args]

    def add(self, a: Coefficient, b: Coefficient) -> Coefficient | None:
        """Returns the sum; None if it is 0."""
        residues = tuple((x + y) % P for x, y in zip(a.residues, b.residues, strict=True))
        if not any(residues):
            return None
        if isinstance(a.arg, float) and isinstance(b.arg, float):
            return Coefficient(a.arg + b.arg, residues)
        return Coefficient(self._put("add", a.arg, b.arg), residues)

    def mul(self, a: Coefficient, b: Coefficient) -> Coefficient:
        """Returns the product."""
        residues = tuple(x * y % P for x, y in zip(a.residues, b.residues, strict=True))
        if isinstance(a.arg, float) and isinstance(b.arg, float):
            return Coefficient(a.arg * b.arg, residues)
        if 1.0 in (a.arg, b.arg):
            return Coefficient(b.arg if a.arg == 1.0 else a.arg, residues)
        if -1.0 in (a.arg, b.arg):
            return Coefficient(self._put("neg", b.arg if a.arg == -1.0 else a.arg), residues)
        return Coefficient(self._put("mul", a.arg, b.arg), residues)

    def inverse(self, a: Coefficient) -> Coefficient | None:
        """Returns the reciprocal."""
        if not all(a.residues):
            return None
        return Coefficient(self._put("div", 1.0, a.arg), tuple(pow(r, -1, P) for r in a.residues))


class Polynomials:
    """Values of a flat program as polynomials: in the inputs that the loop changes, and in the variables of a polygon."""

    def __init__(self, steady: Steady, residues: Sequence[Residues], varying: set[Arg], data: set[Arg]) -> None:
        self.steady, self._residues, self.varying, self.data = steady, residues, varying, data
        self.known: dict[Arg, Poly | None] = {}
        self.residuals: dict[Arg, Poly] = {}

    def of(self, arg: Arg) -> Poly | None:
        """Returns the polynomial of a value, if it is one."""
        if not isinstance(arg, str):
            return None if residue_of(float(arg)) is None else {ONE: self.steady.number(float(arg))} if arg else {}
        if arg not in self.known:
            if arg in self.varying:
                self.known[arg] = self.variable(arg)
            else:
                found = [r.of(arg) for r in self._residues]
                random = [random_residue("steady", point, arg) for point in range(POINTS)]
                given = tuple(r if r is not None else other for r, other in zip(found, random, strict=True))
                self.known[arg] = {ONE: Coefficient(arg, given)} if any(given) else {}
        return self.known[arg]

    def variable(self, name: str) -> Poly:
        """Returns a polynomial that is a variable."""
        return {((name, 1),): self.steady.number(1.0)}

    def total(self, terms: Iterable[Poly]) -> Poly:
        """Returns the sum."""
        result: Poly = {}
        for term in terms:
            for monomial, c in term.items():
                self._add_to(result, monomial, c)
        return result

    def _add_to(self, result: Poly, monomial: Monomial, c: Coefficient) -> None:
        both = self.steady.add(result[monomial], c) if monomial in result else c
        if both is None:
            del result[monomial]
        else:
            result[monomial] = both

    def product(self, p: Poly, q: Poly) -> Poly | None:
        """Returns the product; None if it is too large."""
        if len(p) * len(q) > MOST_TERMS:
            return None
        result: Poly = {}
        for m, a in p.items():
            for n, b in q.items():
                exponents = dict(m)
                for name, k in n:
                    exponents[name] = exponents.get(name, 0) + k
                monomial = tuple(sorted(exponents.items()))
                if sum(exponents.values()) > MOST_DEGREE:
                    return None
                self._add_to(result, monomial, self.steady.mul(a, b))
        return result

    def follow(self, block: Iterable[Stmt], in_polygon: bool = False) -> None:
        """Notes the polynomials of assignments. In a polygon, a sum with data in it becomes a variable: a residual."""
        for s in block:
            if not isinstance(s, Assign) or not is_number(s.name) or self.varying.isdisjoint(s.args):
                continue
            self.varying.add(s.name)
            found = self._result(s)
            if found is None:
                found = self.variable(s.name)
                self.data.add(s.name)
            elif in_polygon and s.op in ("add", "sub") and self._is_residual(found):
                self.residuals[s.name] = found
                found = self.variable(s.name)
            self.known[s.name] = found

    def _is_residual(self, p: Poly) -> bool:
        """Returns whether data of a box is among the terms of a sum."""
        powers = [sum(k for name, k in m if name in self.data) for m in p]
        return len(p) > 1 and max(powers) == 1

    def difference(self, p: Poly, q: Poly) -> Poly:
        """Returns p - q."""
        minus = self.steady.number(-1.0)
        return self.total([p, {m: self.steady.mul(minus, c) for m, c in q.items()}])

    def _result(self, s: Assign) -> Poly | None:
        args = [self.of(a) for a in s.args]
        parts = [p for p in args if p is not None]
        if len(parts) < len(args):
            return None
        match s.op:
            case "const":
                return parts[0]
            case "add":
                return self.total(parts)
            case "neg":
                return self.difference({}, parts[0])
            case "sub":
                return self.difference(parts[0], parts[1])
            case "mul":
                return self._power(parts)
            case "powi" if 0 < int(s.args[1]) <= MOST_DEGREE:
                return self._power([parts[0]] * int(s.args[1]))
            case "div" if s.args[1] not in self.varying and set(parts[1]) == {ONE}:
                inverse = self.steady.inverse(parts[1][ONE])
                return None if inverse is None else self.product(parts[0], {ONE: inverse})
            case _:
                return None

    def _power(self, factors: Sequence[Poly]) -> Poly | None:
        result: Poly | None = factors[0]
        for factor in factors[1:]:
            result = None if result is None else self.product(result, factor)
        return result


def derivative(p: Poly, name: str) -> dict[Monomial, tuple[int, ...]]:
    """Returns the derivative of a polynomial by a variable, as residues."""
    result: dict[Monomial, tuple[int, ...]] = {}
    for m, c in p.items():
        exponents = dict(m)
        k = exponents.get(name, 0)
        if not k:
            continue
        exponents[name] -= 1
        rest = tuple((n, e) for n, e in sorted(exponents.items()) if e)
        given = result.get(rest, (0,) * POINTS)
        result[rest] = tuple((a + k * b) % P for a, b in zip(given, c.residues, strict=True))
    return {m: r for m, r in result.items() if any(r)}
