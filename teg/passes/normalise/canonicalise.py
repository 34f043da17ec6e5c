"""Canonical atoms: one surface, one expression.

    [−2x + 2t > 0], [x < t], ~[t < x], [a·x < a·t]        all become conditions on the one atom  t - x > 0

1. A condition inside an atom is hoisted: [g > 0] = b & [g|b:=true > 0]  |  ~b & [g|b:=false > 0], if there are few. If there are many,
   the continuous ones (abs, minimum, maximum) become |·|, which is not a condition (`teg.analysis.kinks`).
2. Factors split: [u·v > 0] = [u > 0] & [v > 0]  |  [u < 0] & [v < 0], so that (y - c)·(x - t) has two surfaces with two owners.
   A surface is written without an increasing function or an odd power in front of both sides, and a quadratic one that is two lines as
   these (`teg.analysis.coincidence`).
3. A surface proportional to an earlier one by a number, or by denominators without variables, becomes that one; sign and strictness are
   adjusted.
4. An atom that a bound decides (x < t on (0, t)) is replaced by its value at the other bound.
5. An atom whose function is 0 everywhere, as in (a + x)·(a - x) < a² - x², is decided: by rounding it would be true here and there.
6. An integral of a polynomial that a condition depends on is written out: [∫₀ˣ(1 - u/p)du > 0] is a condition on x - x²/(2p).
7. ∫ΣFᵢ = Σ∫Fᵢ if the terms have different atoms, and factors free of x leave ∫ dx.

Linear in the program, up to the few conditions that are hoisted.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from itertools import islice
from typing import cast

from teg.analysis.antiderivative import integrated
from teg.analysis.coincidence import without_denominators
from teg.analysis.expanded import shorter_form
from teg.analysis.extents import Extents
from teg.analysis.jumps import assign
from teg.analysis.kinks import Extremes, Kinks, kinks_of, value_nodes
from teg.analysis.polynomial import Shadow
from teg.analysis.proportional import Proportional
from teg.analysis.singularities import Keys, factors_of, is_singular
from teg.analysis.surfaces import atoms_of, binders_inside
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.expr import FALSE, MINUS_ONE, TRUE, Add, Call, Compare, Cond, Const, Expr, Mul, Param, Pow, Var, Where, const
from teg.ir.integral import Delta, Integral, delta, scaled_integral
from teg.ir.node import Node, postorder, union
from teg.ir.simplify import add, conjunction, disjunction, mul, negation, positive
from teg.ir.traverse import rebuild, remake, rename_apart, replace_node, rewrite, substitute
from teg.numerics.field import divided, sign_of_residue
from teg.passes.normalise.denominators import cleared, cleared_delta, has_variable_denominator, tangents_as_quotients
from teg.passes.normalise.factors import signed_factors, without_squares
from teg.passes.normalise.quotients import with_whole_branches
from teg.passes.normalise.radicals import without_radical
from teg.passes.normalise.thresholds import between_exponentials, without_threshold

MAX_HOISTED = 6
FEW_TERMS = 4
"""So many terms with surfaces of their own are integrated one by one, times their common factor."""
MAX_KINKS = 2
"""A surface with more kinks is not split into smooth ones: its roots are isolated as it is. Neither is one with a kink that has no formula:
the places of the kink would be isolated, too, though nothing jumps there."""


def canonicalise(root: Expr) -> Expr:
    """Returns the program with canonical atoms and split integrals. Its value is the same."""
    return Canonical()(root)


class Canonical:
    """Makes programs canonical. Holds the surfaces met so far, up to a factor, and the nodes that are canonical already."""

    def __init__(self) -> None:
        self._surfaces = Proportional()
        self._points = self._surfaces.points
        self._scaled: dict[int, Expr] = {}
        self._new: dict[Node, Node] = {}
        self._extremes = Extremes()
        self._keys = Keys()
        self._singular: set[object] = set()
        self._extents = Extents(dict)  # for all numbers

    def copied(self) -> Canonical:
        """Returns the same, which meets other surfaces apart."""
        other = Canonical()
        other._surfaces = self._surfaces.copied()
        other._points = other._surfaces.points
        other._scaled, other._new, other._singular = dict(self._scaled), dict(self._new), set(self._singular)
        other._extremes, other._keys, other._extents = self._extremes, self._keys, self._extents
        return other

    def __call__(self, root: Expr) -> Expr:
        """Returns the program with canonical atoms and split integrals. Its value is the same."""
        new, order = self._new, postorder([rename_apart(root)])
        deciding, whole = _deciding_integrals(order), _many_kinks(order)
        self._singular.update(self._keys.of(u) for u in _radicals_in_singular_functions(order))
        for node in order:
            if node in new:
                continue
            result = remake(node, tuple([new[c] for c in node.children]))
            if node in deciding and isinstance(result, Integral) and (polynomial := integrated(result)) is not None:
                result = self(polynomial)
            if isinstance(result, Compare):
                if result.resolution is None:
                    result = self._atom(self._extremes.of(result.g) if node in whole else result.g, result.strict, MAX_HOISTED)
                else:
                    result = self._tied(result, MAX_HOISTED)
            elif isinstance(result, Delta):
                result = _split_delta(result, MAX_HOISTED)
            elif isinstance(result, Call) and result.name == "atan2" and result.children[1] is ex.ZERO and result.free:
                above = self._atom(result.children[0], True, MAX_HOISTED)  # on the cut of another one (`cuts.py`) it jumps
                result = simplify.where(above, const(0.5 * math.pi), const(-0.5 * math.pi))
            elif isinstance(result, Integral):
                result = self._integral(result)
            elif isinstance(result, Mul):
                result = with_whole_branches(result)
            new[node] = result
        for node in order:
            new.setdefault(new[node], new[node])
        return cast(Expr, new[order[-1]])

    # -- atoms ---------------------------------------------------------------------------------------------------------

    def atom(self, g: Expr, strict: bool) -> Cond:
        """Returns the condition that a function is positive, by canonical atoms."""
        return self._atom(g, strict, MAX_HOISTED)

    def _atom(self, g: Expr, strict: bool, hoists: int) -> Cond:
        inner = inner_condition(g) if hoists else None
        if inner is not None:
            then = self._atom(decided(g, inner, True), strict, hoists - 1)
            otherwise = self._atom(decided(g, inner, False), strict, hoists - 1)
            return disjunction(conjunction(inner, then), conjunction(negation(inner), otherwise))
        if all(p.value(g) == 0 for p in self._points):  # rounding would decide a difference that is 0 everywhere
            return FALSE if strict else TRUE
        g = tangents_as_quotients(g)
        if has_variable_denominator(g):
            numerator, denominator = cleared(g)
            g = mul(numerator, denominator)
        sign, factors = signed_factors(g)
        if len(factors) == 1 and sign and (level := without_threshold(mul(const(sign), factors[0]))) is not None:
            always, beyond, counts = level
            return disjunction(always, conjunction(counts, self._atom(beyond, strict, hoists)))
        if len(factors) == 1 and sign and (larger := between_exponentials(mul(const(sign), factors[0]), strict)) is not None:
            return self._each_atom(larger, hoists)
        varying, fixed = [f for f in factors if f.free], [f for f in factors if not f.free]
        whole = mul(const(sign), varying[0]) if len(varying) == 1 and sign else g
        if self._keys.of(whole) not in self._singular and (polynomials := without_radical(whole, strict)) is not None:
            if whole is g or not fixed:
                return self._each_atom(polynomials, hoists)
            opposite = without_radical(mul(MINUS_ONE, whole), strict)
            sides = self._each_atom(polynomials, hoists), self._each_atom(cast(Cond, opposite), hoists)
            return self._product([self._surfaces.representative(f) for f in fixed], strict, sides)
        found = [self._representatives(factor) for factor in factors]
        surfaces, sign = without_squares([s for own, _ in found for s in own], sign)
        denominators, sign = without_squares([s for _, under in found for s in under], sign, parameters_too=True)
        surfaces += denominators
        if not surfaces:
            return TRUE if sign > 0 or (sign == 0 and not strict) else FALSE
        above, below = (self._side(surfaces[-1], strict, upward) for upward in (sign > 0, sign < 0))
        return self._product(surfaces[:-1], strict, (above, below))

    def _each_atom(self, condition: Cond, hoists: int) -> Cond:
        """Returns a condition with its atoms canonical."""

        def visit(old: Node, new: Node) -> Node:
            return self._atom(old.g, old.strict, hoists) if isinstance(old, Compare) else new

        return cast(Cond, rewrite([condition], visit)[condition])

    def _tied(self, atom: Compare, hoists: int) -> Cond:
        """Returns an atom that can meet a tie, made by substitution during sifting.

        Its conditions, denominators and terms that cancel are canonicalised again; the resolution is kept.
        """
        g, strict, resolution = atom.g, atom.strict, cast(Cond, atom.resolution)
        inner = inner_condition(g) if hoists else None
        if inner is not None:
            branches = (positive(decided(g, inner, value), strict, resolution, atom.rivals) for value in (True, False))
            then, otherwise = (self._tied(b, hoists - 1) if isinstance(b, Compare) else b for b in branches)
            return disjunction(conjunction(inner, then), conjunction(negation(inner), otherwise))
        if any(Shadow((v,)).degree(g) == 0 for v in g.free):
            normal = shorter_form(g, variables=True)
            if normal is not None:
                return positive(normal, strict, resolution, atom.rivals)
        if not has_variable_denominator(g):
            return atom
        numerator, denominator = cleared(g)
        above = self._atom(denominator, True, 0)
        plus = positive(numerator, strict, resolution, atom.rivals)
        minus = negation(positive(numerator, not strict, negation(resolution), atom.rivals))
        return disjunction(conjunction(above, plus), conjunction(negation(above), minus))

    def _representatives(self, g: Expr) -> tuple[list[tuple[Expr, bool]], list[tuple[Expr, bool]]]:
        """Returns the surfaces whose signs together are that of g: one met before, and apart the denominators by which g is divided.

        So 1 - x/a is the surface a - x and the sign of a. Not the other way round: a - x has a sign where a is 0.
        """
        surface, same = self._surfaces.representative(g)
        if surface is not g or not isinstance(g, Add) or not g.free:
            return [(surface, same)], []
        *terms, below = without_denominators(*g.children)
        numerator = add(*terms) if below is not ex.ONE else g
        first, second = (p.value(numerator) for p in self._points)
        if not (first and second):
            return [(surface, same)], []
        if below is ex.ONE:
            known = self._scaled.setdefault(divided(second, first), g)
        else:
            known = self._scaled.get(divided(second, first), g)
        other = None if known is g else self._points[0].value(known)
        sign = sign_of_residue(divided(first, other)) if other else None
        if sign is None or not known.free <= g.free:
            return [(surface, same)], []
        sign_below, factors = signed_factors(below)
        return [(known, sign * sign_below > 0)], [self._surfaces.representative(f) for f in factors]

    def _product(self, surfaces: Sequence[tuple[Expr, bool]], strict: bool, sides: tuple[Cond, Cond]) -> Cond:
        """Returns the condition that the product of surfaces and of a factor, whose two sides are known, is positive."""
        above, below = sides
        for surface in reversed(surfaces):
            plus, minus = self._side(surface, strict, True), self._side(surface, strict, False)
            above, below = (
                disjunction(conjunction(plus, above), conjunction(minus, below)),
                disjunction(conjunction(plus, below), conjunction(minus, above)),
            )
        return above

    def _side(self, surface: tuple[Expr, bool], strict: bool, upward: bool) -> Cond:
        """Returns [g > 0] (or >=), or [g < 0], as a condition on the representative of a surface."""
        g, same = surface
        if isinstance(g, Const):
            return positive(g if upward else mul(MINUS_ONE, g), strict)
        if strict and upward != same and not g.free and self._extents.of(g)[0] >= 0.0:
            return FALSE
        return positive(g, strict) if upward == same else negation(positive(g, not strict))

    # -- integrals -----------------------------------------------------------------------------------------------------

    def _integral(self, node: Integral) -> Expr:
        x, lo, hi = node.var, node.lo, node.hi
        terms = _separable_terms(node.body, x)
        return add(*(self._decided(scaled_integral(term, x, lo, hi)) for term in terms))

    def _decided(self, e: Expr) -> Expr:
        """Returns the expression with the atoms replaced that a bound of this integral decides."""
        integral = next((n for n in _product_integrals(e)), None)
        if integral is None:
            return e
        x, body = integral.var, integral.body
        inner = binders_inside(body)
        numeric = isinstance(integral.lo, Const) and isinstance(integral.hi, Const)  # otherwise parameters in g leave nothing to decide
        changed: dict[Compare, Cond] = {}
        for atom in atoms_of(body, x):
            if atom.g.free & inner or atom.resolution is not None or (numeric and atom.g.kinds & Param.bit):
                continue
            for bound, other in ((integral.hi, integral.lo), (integral.lo, integral.hi)):
                if Shadow((x,)).degree(atom.g) != 1:
                    break
                at_bound = cast(Expr, substitute(atom.g, {x: bound}))
                if all(p.value(at_bound) == 0 for p in self._points):
                    changed[atom] = self._atom(cast(Expr, substitute(atom.g, {x: other})), atom.strict, 0)
                    break
        if not changed:
            return e
        new: dict[Node, Node] = {}
        for node in postorder([e]):
            result = rebuild(node, tuple([new[c] for c in node.children]))
            new[node] = changed.get(node, cast(Cond, result)) if isinstance(node, Compare) else result
            if node is integral and isinstance(new[node], Integral):
                decided = cast(Integral, new[node])
                new[node] = scaled_integral(decided.body, decided.var, decided.lo, decided.hi)
        return cast(Expr, new[e])


def _deciding_integrals(order: list[Node]) -> set[Node]:
    """Returns the integrals in atoms that depend on variables. Where they are polynomials the atom is one."""
    atoms = [n.g for n in order if isinstance(n, Compare) and n.g.has_integral and n.free]
    return {n for n in postorder(atoms) if isinstance(n, Integral) and n.free} if atoms else set()


def _radicals_in_singular_functions(order: list[Node]) -> Iterator[Expr]:
    """Returns functions with square roots, of which powers, roots or logarithms are taken. Their own zeros are breaks, as they are."""
    for node in order:
        if isinstance(node, Call) and is_singular(node):
            yield from (u for u in factors_of(node.children[0]) if any(isinstance(n, Call) and n.name == "sqrt" for n in postorder([u])))


def _many_kinks(order: list[Node]) -> set[Compare]:
    """Returns the atoms that are not split, and those of all kinks in them: their kinks stay as they are."""
    few: dict[Node, frozenset[Where]] = {}  # of nodes with branches below
    none: frozenset[Where] = frozenset()
    many: set[Compare] = set()
    waiting: list[Expr] = []
    kinks = Kinks()
    for node in order:
        if not node.kinds & Where.bit:
            continue
        if isinstance(node, Add | Mul | Pow | Call):
            few[node] = none.union(*[few.get(c, none) for c in node.children])
        elif isinstance(node, Where):
            own = frozenset((node,)) if node.condition.free else none
            few[node] = own | few.get(node.then, none) | few.get(node.otherwise, none)
        else:
            few[node] = none
        few[node] = frozenset(islice(few[node], MAX_KINKS + 1))  # so many are many
        if isinstance(node, Compare) and _stays_whole(few.get(node.g, none), kinks):
            many.add(node)
            waiting.append(node.g)
    seen: set[Expr] = set()
    for g in waiting:
        for kink in value_nodes(g, seen):
            seen.add(kink)
            if isinstance(kink, Where) and isinstance(kink.condition, Compare) and kinks.sign(kink):
                many.add(kink.condition)
    return many


def _stays_whole(branches: Collection[Where], kinks: Kinks) -> bool:
    """Returns whether a surface with these branches is not split: they are many, or one is a kink where a function without formula is 0."""
    if len(branches) > MAX_KINKS:
        return True
    return any(isinstance(b.condition, Compare) and not _has_formula(b.condition.g) and kinks.sign(b) for b in branches)


def _has_formula(g: Expr) -> bool:
    """Returns whether a surface is linear or quadratic in one of its variables."""
    return any(Shadow((v,)).degree(g) in (1, 2) for v in g.free)


def _split_delta(d: Delta, hoists: int) -> Expr:
    """Returns δ(where(b, u, v)) as where(b, δ(u), δ(v)): equal almost everywhere, because a condition's own border is no root."""
    g = Extremes().of(d.g) if hoists == MAX_HOISTED and _stays_whole(kinks_of(d.g), Kinks()) else d.g
    inner = inner_condition(g) if hoists else None
    if inner is None:
        return cleared_delta(g)
    branches = (delta(decided(g, inner, value)) for value in (True, False))
    return simplify.where(inner, *(_split_delta(b, hoists - 1) if isinstance(b, Delta) else b for b in branches))


def _product_integrals(e: Expr) -> list[Integral]:
    """Returns the integral that `scaled_integral` made, which may have factors and conditions in front of it."""
    if isinstance(e, Where):
        e = e.then
    parts = e.children if isinstance(e, Mul) else (e,)
    return [p for p in reversed(parts) if isinstance(p, Integral)][:1]


def inner_condition(g: Expr) -> Cond | None:
    """Returns a condition, dependent on variables, of a `where` in value position of g: it must be hoisted out of the atom. None if there
    is none."""
    stack: list[Expr] = [g]
    seen: set[Expr] = set()
    while stack:
        node = stack.pop()
        if node in seen or not node.kinds & Where.bit:
            continue
        seen.add(node)
        if isinstance(node, Where):
            if node.condition.free:
                return node.condition
            stack += [node.otherwise, node.then]
        elif isinstance(node, Add | Mul | Pow | Call):
            stack.extend(cast("tuple[Expr, ...]", node.children[::-1]))
    return None


def decided(g: Expr, condition: Cond, value: bool) -> Expr:
    """Returns g with one condition taken as true or false."""
    if isinstance(condition, Compare):
        return cast(Expr, assign(g, condition.g, value))
    return cast(Expr, replace_node(g, condition, TRUE if value else FALSE))


def _separable_terms(body: Expr, x: Var) -> list[Expr]:
    """Returns the summands of an integrand in groups: terms with the same atoms in x stay together, and so do terms
    that may diverge alone."""
    if not isinstance(body, Add | Mul):
        return [body]
    flat: list[Expr] = []
    stack: list[Expr] = [body]
    while stack:
        e = stack.pop()
        if isinstance(e, Add):
            stack.extend(reversed(e.children))
        elif isinstance(e, Mul) and (products := _distributed(e, x)):
            stack.extend(reversed(products))
        else:
            flat.append(e)
    atoms, divergent = _facts(flat, x)
    groups: dict[object, list[Expr]] = {}
    for term in flat:
        key: object = atoms.get(term, frozenset())
        if term.has_delta:
            key = term
        elif term in divergent:
            key = "may diverge"
        groups.setdefault(key, []).append(term)
    return [add(*terms) for terms in groups.values()] if len(groups) > 1 else [body]


def _distributed(e: Mul, x: Var) -> list[Expr]:
    """Returns the products of a factor that has an antiderivative with each term of a sum; nothing unless these are several terms, each
    with surfaces of its own. Together every piece between two surfaces would ask for all of them."""
    sums = [f for f in e.children if isinstance(f, Add) and any(isinstance(n, Compare) and x in n.free for n in postorder([f]))]
    if len(sums) != 1 or e.has_delta or e.has_integral:
        return []
    (total,) = sums
    others = [f for f in e.children if f is not total]
    atoms, divergent = _facts(list(e.children), x)
    if any(atoms.get(f, _NONE) for f in others) or any(f in divergent for f in e.children) or not all(_is_elementary(f, x) for f in others):
        return []
    groups: dict[frozenset[Expr], list[Expr]] = {}
    for term in total.children:
        groups.setdefault(atoms.get(term, _NONE), []).append(term)
    return [mul(*others, add(*terms)) for terms in groups.values()] if len(groups) >= FEW_TERMS else []


def _is_elementary(f: Expr, x: Var) -> bool:
    """Returns whether a factor is a polynomial in x, an exponential or a wave, of which products have antiderivatives."""
    if isinstance(f, Call):
        return f.name in ("exp", "sin", "cos") and Shadow((x,)).degree(f.children[0]) in (0, 1, 2)
    return x not in f.free or Shadow((x,)).degree(f) is not None


def _facts(terms: list[Expr], x: Var) -> tuple[dict[Node, frozenset[Expr]], set[Node]]:
    """Returns, for the nodes below some terms, the surfaces in x, and the nodes with a pole or a logarithm in x (outside of conditions)."""
    atoms: dict[Node, frozenset[Expr]] = {}
    divergent: set[Node] = set()
    for node in postorder(terms):
        if x not in node.free:
            continue
        children = node.children[:1] if isinstance(node, Compare) else node.children
        mine = union([atoms.get(c, _NONE) for c in children])
        if isinstance(node, Compare):
            mine = mine | {node.g}
        atoms[node] = mine
        pole = isinstance(node, Pow) and node.exponent < 0
        singular = isinstance(node, Call) and node.name in ("log", "tan", "pow")
        inherited = not isinstance(node, Compare) and any([c in divergent for c in children])
        if pole or singular or inherited:
            divergent.add(node)
    return atoms, divergent


_NONE: frozenset[Expr] = frozenset()
