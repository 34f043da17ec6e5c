"""Integrals of polynomials over a part of a box from its moments, as arithmetic without nodes.

    integrals(w, body, values, variables, moments)  ->  the integrals of the values

    polynomial        Σ c·XᵖY^q in the box [-1, 1]², c numbers of the flat program; only those that are multiplied are written out
    a sum             the sum of the integrals of its terms
    a product p·q     Σ over monomials m of q of c(m)·∫ p·m; the numbers ∫ p·m are shared by all products of p

Monomials that have no moments are beyond the degree of the values: the terms with them cancel in each.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from teg.backends.c.crossing import Writer
from teg.program import Arg, Assign

Monomial = tuple[int, int]
Poly = dict[Monomial, Arg]
LINEAR = {"add", "sub", "neg", "const"}
MOST_POWER = 4


def box_moments(degree: int) -> dict[Monomial, Arg]:
    """Returns the moments of the whole box [-1, 1]² relative to its area."""
    one = [0.0 if p % 2 else 1.0 / (p + 1) for p in range(degree + 1)]
    return {(p, q): one[p] * one[q] for p in range(degree + 1) for q in range(degree + 1 - p)}


def integrals(
    w: Writer, body: Sequence[Assign], values: Sequence[Arg], variables: Mapping[str, Poly], moments: Mapping[Monomial, Arg]
) -> dict[Arg, Arg] | None:
    """Returns the integral of every value; None if one is not a polynomial."""
    return _Expansion(w, body, variables, moments).integrals(values)


class _Expansion:
    """The polynomials and integrals of one body."""

    def __init__(self, w: Writer, body: Sequence[Assign], variables: Mapping[str, Poly], moments: Mapping[Monomial, Arg]) -> None:
        self.w, self.moments = w, moments
        self.made = {s.name: s for s in body}
        self.inside: set[Arg] = set(variables)
        self.order: list[str] = []
        for s in body:
            if not self.inside.isdisjoint(s.args):
                self.inside.add(s.name)
                self.order.append(s.name)
        self.steady = [s for s in body if s.name not in self.inside]
        self.polys: dict[Arg, Poly] = {name: {m: c for m, c in p.items() if c != 0.0} for name, p in variables.items()}
        self.shared: dict[tuple[Arg, Monomial], Arg] = {}
        products = [[a for a in (s.args if s.op == "mul" else s.args[:1] * 2) if a in self.inside] for s in body if s.op in ("mul", "powi")]
        self.factors = Counter(self._base(a)[0] for moving in products if len(moving) > 1 for a in moving)

    def integrals(self, values: Sequence[Arg]) -> dict[Arg, Arg] | None:
        """Returns the integrals of values, which are written."""
        self.w.lines += self.steady
        summed, expanded = self._needed(values)
        if expanded is None:
            return None
        for name in self.order:
            if name in expanded and name not in self.polys:
                self.polys[name] = self._poly(self.made[name])
        found: dict[Arg, Arg] = {}
        for name in self.order:
            if name in summed:
                found[name] = self._shared(name, (0, 0)) if name in self.polys else self._integral(name, found)
        return {v: found[v] if v in found else self._of_poly(v) for v in values}

    def _needed(self, values: Sequence[Arg]) -> tuple[set[Arg], set[Arg] | None]:
        """Returns the names that are integrated, and those that are written out as polynomials; None if there are others than these."""
        summed: set[Arg] = set(values) & set(self.order)
        expanded: set[Arg] = set()
        for name in reversed(self.order):
            s = self.made[name]
            moving = [a for a in s.args if a in self.inside]
            if not self._is_polynomial(s) and name in summed | expanded:
                return summed, None
            if name in summed:
                linear = s.op in LINEAR or (s.op in ("mul", "div") and len(moving) == 1)
                (summed if linear else expanded).update(a for a in moving if a in self.made)
            if name in expanded:
                expanded.update(a for a in moving if a in self.made)
        return summed, expanded

    def _is_polynomial(self, s: Assign) -> bool:
        if s.op in LINEAR or s.op == "mul":
            return True
        if s.op == "powi":
            return 0 < int(s.args[1]) <= MOST_POWER
        return s.op == "div" and s.args[1] not in self.inside

    def _integral(self, name: str, found: Mapping[Arg, Arg]) -> Arg:
        """Returns the integral of a name from those of its operands, or from their polynomials."""
        w, s = self.w, self.made[name]
        moving = [a for a in s.args if a in self.inside]
        factors = [a for a in s.args if a not in self.inside]

        def of(arg: Arg) -> Arg:
            return found[arg] if arg in found else self._of_poly(arg)

        match s.op:
            case "add":
                return w.add(*map(of, s.args))
            case "sub":
                return w.sub(of(s.args[0]), of(s.args[1]))
            case "neg":
                return w.neg(of(s.args[0]))
            case "const":
                return of(s.args[0])
            case "div":
                return w.div(of(s.args[0]), s.args[1])
            case "mul" if len(moving) == 1:
                return w.mul(*factors, of(moving[0]))
            case _:
                bases = [self._base(a) for a in (moving if s.op == "mul" else [s.args[0]] * int(s.args[1]))]
                factors = [*(factors if s.op == "mul" else ()), *(c for _, by in bases for c in by)]
                moving = [a for a, _ in bases]
                first, *rest = sorted(moving, key=lambda a: (len(self.polys[a]), self.factors[a], str(a)), reverse=True)
                others = self.polys[rest[0]]
                for a in rest[1:]:
                    others = self._product(others, self.polys[a])
                total = w.add(*(w.mul(c, self._shared(first, m)) for m, c in others.items()))
                return w.mul(*factors, total)

    def _base(self, arg: Arg) -> tuple[Arg, list[Arg]]:
        """Returns what a multiple is a multiple of, and the factors."""
        factors: list[Arg] = []
        while (s := self.made.get(str(arg))) is not None and s.op == "mul":
            moving = [a for a in s.args if a in self.inside]
            if len(moving) != 1:
                break
            factors += [a for a in s.args if a not in self.inside]
            arg = moving[0]
        return arg, factors

    def _shared(self, name: Arg, by: Monomial) -> Arg:
        """Returns the integral of a polynomial times a monomial."""
        if (name, by) not in self.shared:
            terms = [(self.moments.get((p + by[0], q + by[1]), 0.0), c) for (p, q), c in self.polys[name].items()]
            self.shared[name, by] = self.w.add(*(self.w.mul(m, c) for m, c in terms))
        return self.shared[name, by]

    def _of_poly(self, arg: Arg) -> Arg:
        """Returns the integral of a polynomial that is a variable, or of a number."""
        return self._shared(arg, (0, 0)) if arg in self.polys else self.w.mul(self.moments[0, 0], arg)

    # -- polynomials -----------------------------------------------------------------------------------------------------

    def _poly_of(self, arg: Arg) -> Poly:
        return self.polys.get(arg, {(0, 0): arg})

    def _poly(self, s: Assign) -> Poly:
        """Returns the polynomial of an assignment."""
        w = self.w
        parts = [self._poly_of(a) for a in (s.args[:1] if s.op == "powi" else s.args)]
        match s.op:
            case "const":
                return parts[0]
            case "neg":
                return {m: w.neg(c) for m, c in parts[0].items()}
            case "sub":
                monomials = dict.fromkeys((*parts[0], *parts[1]))
                return {m: w.sub(parts[0].get(m, 0.0), parts[1].get(m, 0.0)) for m in monomials}
            case "add":
                monomials = dict.fromkeys(m for p in parts for m in p)
                return {m: w.add(*(p[m] for p in parts if m in p)) for m in monomials}
            case "div":
                inverse = w.div(1.0, s.args[1])
                return {m: w.mul(c, inverse) for m, c in parts[0].items()}
            case _:
                factors = parts if s.op == "mul" else parts * int(s.args[1])
                result = factors[0]
                for factor in factors[1:]:
                    result = self._product(result, factor)
                return result

    def _product(self, p: Poly, q: Poly) -> Poly:
        terms: dict[Monomial, list[Arg]] = {}
        for (i, j), a in p.items():
            for (k, m), b in q.items():
                terms.setdefault((i + k, j + m), []).append(self.w.mul(a, b))
        return {m: self.w.add(*parts) for m, parts in terms.items() if m in self.moments}
