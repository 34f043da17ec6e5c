"""Sums of polynomials over nodes of a box, from its moments instead: the coefficients are the same for all nodes.

    Σ over nodes of weight·value = ∫∫ value dX dY = Σ C_pq·M_pq,     M_pq = ∫∫ XᵖY^q dX dY

A sum is taken apart first, and factors that are the same at all nodes come out of it. A product of two factors is A·(T B), where (T B)_pq =
∫∫ XᵖY^q·B: what stands in several products is B, and T B is computed once. Gradients consist of such products: residuals, each times the
coordinates. A value's degree is known; powers beyond it, which cancel in the value, are left out wherever they come up.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from teg.backends.c.crossing import Moments, Writer
from teg.program import Arg, Assign

Polynomial = dict[tuple[int, int], Arg]
"""Coefficients of XᵖY^q by (p, q), without those that are 0."""
Affine = dict[Arg, Polynomial]
"""The variables of a body as functions of X and Y."""
Factors = tuple[list[Arg], list[Arg]]
"""Factors that are the same at all nodes, and names of those that are not."""


class Expansion:
    """The integrals over a box of what a body of assignments computes, written to `w`.

    `affine` are the polynomials of the variables, `moments` those of the box. Assignments without variables are written as they are.
    """

    def __init__(self, w: Writer, affine: Affine, moments: Moments, body: Iterable[Assign]) -> None:
        self.w, self.moments = w, moments
        self.made: dict[Arg, Assign] = {}
        self._polynomials: dict[Arg, Polynomial] = dict(affine)
        self._varying: set[Arg] = set(affine)
        for s in body:
            if self._varying.isdisjoint(s.args):
                w.lines.append(s)
            else:
                self._varying.add(s.name)
                self.made[s.name] = s
        self._factors: dict[Arg, Factors] = {}
        self._integrals: dict[Arg, Arg] = {}
        self._integrals_of: dict[tuple[Arg, ...], Arg] = {}
        self._times: dict[Arg, Polynomial] = {}
        self._uses = Counter(f for s in self.made.values() if s.op in ("mul", "powi") for f in set(self._taken_apart(s.name)[1]))

    def integral(self, value: Arg) -> Arg:
        """Returns ∫∫ value dX dY. The recursion is as deep as the polynomial's expression is nested."""
        if value not in self._varying:
            return self.w.mul(value, self.moments[0, 0])
        if value not in self._integrals:
            self._integrals[value] = self._integral(value)
        return self._integrals[value]

    def _integral(self, value: Arg) -> Arg:
        w, s = self.w, self.made.get(value)
        if s is None:
            return self._against(self._polynomials[value], self.moments)
        match s.op:
            case "add":
                return w.add(*map(self.integral, s.args))
            case "sub":
                return w.sub(*map(self.integral, s.args))
            case "select":
                return w.select(s.args[0], *map(self.integral, s.args[1:]))
        same, varying = self._taken_apart(value)
        if len(varying) == 1:
            return w.mul(*same, self.integral(varying[0]))
        return w.mul(*same, self._of_product(tuple(sorted(varying, key=lambda f: (self._uses[f], str(f))))))

    def _of_product(self, factors: tuple[Arg, ...]) -> Arg:
        """Returns ∫∫ of a product of several factors, the one that is used most the last."""
        if factors not in self._integrals_of:
            by = self._product(factors[1:-1], self.polynomial(factors[0]))
            degree = max((p + q for p, q in by), default=0)
            self._integrals_of[factors] = self._against(by, self._moments_with(factors[-1], degree))
        return self._integrals_of[factors]

    def _taken_apart(self, value: Arg) -> Factors:
        """Returns the factors of a product, taken apart as far as they are products."""
        if value in self._factors:
            return self._factors[value]
        s = self.made.get(value)
        same: list[Arg] = []
        varying: list[Arg] = []
        if s is None or s.op in ("add", "sub", "select"):
            varying.append(value)
        else:
            args: Sequence[Arg] = s.args
            match s.op:
                case "neg":
                    same.append(-1.0)
                case "div":
                    same.append(self.w.div(1.0, s.args[1]))
                    args = s.args[:1]
                case "powi":
                    args = s.args[:1] * int(s.args[1])
            for a in args:
                if a not in self._varying:
                    same.append(a)
                else:
                    factors = self._taken_apart(a)
                    same += factors[0]
                    varying += factors[1]
        if len(same) > 1:
            signs = sum(f == -1.0 for f in same) % 2
            same = [self.w.mul(*[-1.0] * signs, *(f for f in same if f != -1.0))]
        self._factors[value] = same, varying
        return self._factors[value]

    def polynomial(self, value: Arg) -> Polynomial:
        """Returns the coefficients of a value."""
        if value not in self._varying:
            return {} if value == 0.0 else {(0, 0): value}
        if value not in self._polynomials:
            self._polynomials[value] = self._polynomial(value)
        return self._polynomials[value]

    def _polynomial(self, value: Arg) -> Polynomial:
        w, s = self.w, self.made[value]
        if s.op in ("add", "sub", "select"):
            parts = [self.polynomial(a) for a in (s.args[1:] if s.op == "select" else s.args)]
            keys = dict.fromkeys(k for part in parts for k in part)
            rows = {k: [part.get(k, 0.0) for part in parts] for k in keys}
            combined: dict[tuple[int, int], Arg] = {}
            for k, row in rows.items():
                combined[k] = w.add(*row) if s.op == "add" else w.sub(*row) if s.op == "sub" else w.select(s.args[0], *row)
            return combined
        same, varying = self._taken_apart(value)
        found = self._product(varying[1:], self.polynomial(varying[0]))
        return {k: w.mul(*same, c) for k, c in found.items()}

    def _product(self, factors: Iterable[Arg], by: Polynomial) -> Polynomial:
        for f in factors:
            terms: dict[tuple[int, int], list[Arg]] = {}
            for (p, q), a in self.polynomial(f).items():
                for (r, s), b in by.items():
                    if (p + r, q + s) in self.moments:
                        terms.setdefault((p + r, q + s), []).append(self.w.mul(a, b))
            by = {k: self.w.add(*parts) for k, parts in terms.items()}
        return by

    def _moments_with(self, factor: Arg, degree: int) -> Polynomial:
        """Returns the moments to a degree of a factor's product with the density."""
        found = self._times.setdefault(factor, {})
        for p, q in self.moments:
            if p + q <= degree and (p, q) not in found:
                moved = {(p + r, q + s): c for (r, s), c in self.polynomial(factor).items()}
                found[p, q] = self._against(moved, self.moments)
        return found

    def _against(self, by: Polynomial, moments: Mapping[tuple[int, int], Arg]) -> Arg:
        return self.w.add(*(self.w.mul(c, moments[k]) for k, c in by.items() if k in moments))
