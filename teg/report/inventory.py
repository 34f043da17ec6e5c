"""The surfaces of a program: who owns each, how its δ is eliminated, or why it has none."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, cast

from teg.analysis.isolation import max_roots, widened
from teg.analysis.jumps import jump, vanishes_on
from teg.analysis.nest import Binder
from teg.analysis.polynomial import Point, Shadow
from teg.analysis.roots import solve
from teg.analysis.staircase import is_step, with_floors
from teg.analysis.surfaces import atoms_of, binders_inside, owned_surfaces
from teg.ir.expr import ONE, ZERO, Call, Compare, Expr, Param, Tuple, UncountedFloor, Var
from teg.ir.integral import Delta, Integral
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.ir.simplify import tuple_of, where
from teg.ir.traverse import parameters, rename_apart, substitute
from teg.numerics.field import P, divided, residue
from teg.passes.eliminate.affine import Affine
from teg.passes.eliminate.bilinear import Bilinear
from teg.passes.eliminate.conic import Conic
from teg.passes.eliminate.families import Closed, Families, find_family
from teg.passes.eliminate.implicit import Implicit
from teg.passes.eliminate.mapped import Mapped
from teg.passes.eliminate.univariate import Solvable
from teg.passes.normalise.canonicalise import canonicalise

LONGEST = 2000
LARGEST = 400
"""The largest number of nodes of an expression that is printed."""

Nest = tuple[Integral, ...]
"""Nested integrals, the outermost first."""
Entry = dict[str, Any]


def text_of(e: Expr) -> str:
    """Returns one line, or the number of nodes."""
    order = postorder([e])
    long = f"an expression of {len(order)} nodes"
    if len(order) > LARGEST:
        return long
    text = show(e, LONGEST)
    return text if "\n" not in text else long


def nests(root: Node) -> dict[Node, Nest]:
    """Returns the integrals around every integral (itself last) and every δ; outer ones come before inner ones."""
    found: dict[Node, Nest] = {}
    seen: set[Node] = set()
    stack: list[tuple[Node, Nest]] = [(root, ())]
    while stack:
        node, around = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if isinstance(node, Integral):
            found[node] = (*around, node)
            stack += [(node.hi, around), (node.lo, around), (node.body, found[node])]
        else:
            if isinstance(node, Delta):
                found[node] = around
            stack.extend((c, around) for c in reversed(node.children))
    return found


class Forms(NamedTuple):
    """A program as `written`, its normal form `before` the user's δ are eliminated, and its `normal` form."""

    written: Expr
    before: Expr
    normal: Expr


class Inventory:
    """The surfaces of the normal form of what the user wrote."""

    def __init__(
        self,
        forms: Forms,
        wrt: Iterable[Param],
        *,
        estimator: str,
        families: Families,
        closed: Sequence[Closed],
        max_roots: int,
    ) -> None:
        self.written, self.before, self.normal = forms
        self.wrt = frozenset(wrt)
        self.estimator = estimator
        self.families = families
        self.closed = closed
        self.max_roots = max_roots
        bound = [n.var for root in (self.before, self.normal) for n in postorder([root]) if isinstance(n, Integral)]
        self.variables: list[Var] = list(dict.fromkeys(bound))  # innermost first, as in the elimination
        self._points = (Point("first"), Point("second"))
        self._along = tuple(Point("along", {v: residue("along", i, v.name) for v in self.variables}) for i in range(3))
        self._families: dict[tuple[Expr, Nest], Entry] = {}
        self.apart = cast(Expr, rename_apart(self.written))
        self._conditions = _conditions(self.apart)
        self._plain = {self._key(g) for parts in self._conditions.values() for g in parts}

    # -- surfaces with an owner ----------------------------------------------------------------------------------------

    def surfaces(self) -> list[Entry]:
        """Returns the surfaces that integrals own, each once, with the steps of one floor together, and the surfaces of the user's δ."""
        found: dict[tuple[Expr, str], Entry] = {}
        if self.before.has_delta:
            for node, around in nests(self.before).items():
                if isinstance(node, Delta):
                    mine = [i for i in around if i.var in node.g.free]
                    owner = f"∫ d{mine[-1].var.name}" if mine else ""
                    found.setdefault((node.g, owner), self._with_delta(node.g, around, owner, "a δ of the program; "))
        own = {a.g for a in atoms_of(self.before)}
        for node, around in nests(self.normal).items():
            if isinstance(node, Integral):
                for g in owned_surfaces(node.body, node.var):
                    if g not in own and not self._moves(g):
                        continue  # a bound of a user's δ
                    key = (g, f"∫ d{node.var.name}")
                    if key not in found or found[key]["status"] == "kink":
                        entry = self._of(g, node, around)
                        if key not in found or entry["status"] != "kink":
                            found[key] = entry
        return self._with_steps_together(found)

    def _moves(self, g: Expr) -> bool:
        return any(n in self.wrt for n in postorder([g]))

    def _of(self, g: Expr, node: Integral, around: Nest) -> Entry:
        owner = f"∫ d{node.var.name}"
        if not self._moves(g):
            what = "no parameter" if not parameters(g) else "no parameter that is differentiated by"
            return entry_of(g, owner, "fixed", f"does not move: {what} in it")
        if any(isinstance(n, UncountedFloor) for n in postorder([g])):
            return entry_of(g, owner, "uncounted", "beyond the steps that are counted: the value is right, derivatives are NaN")
        j = jump(node.body, g)
        if j is ZERO or vanishes_on(j, g):
            return entry_of(g, owner, "kink", "a kink: the integrand does not jump there")
        if self.estimator == "ignore":
            return entry_of(g, owner, "ignored", "ignored: discontinuities='ignore'")
        if self.estimator != "exact":
            return entry_of(g, owner, "estimated", f"its motion is estimated: discontinuities={self.estimator!r}")
        return self._with_delta(g, around, owner)

    def _with_delta(self, g: Expr, around: Nest, owner: str, before: str = "") -> Entry:
        mine = tuple(i for i in around if i.var in self.variables)
        if (g, mine) not in self._families:
            self._families[g, mine] = self._family(g, mine)
        how = self._families[g, mine]
        return {**entry_of(g, owner, "eliminated", before + how["treatment"]), **{k: v for k, v in how.items() if k != "treatment"}}

    def _family(self, g: Expr, around: Nest) -> Entry:
        """Returns the choice of the elimination, from the same list of families; `treatment` in words."""
        found = find_family(g, [v for v in self.variables if v in g.free], self.families)
        note = ""
        if found is not None and any(b.free for i in around if i.var in found[0].variables for b in (i.lo, i.hi)):
            chain = _chain(around, found[0].variables)
            if chain and found[1](g, ONE, chain, found[0]) is None:  # as in the elimination: the innermost possible variable
                single = (find_family(g, [b.var], self.families) for b in reversed(chain) if b.var in g.free)
                found = next((f for f in single if f is not None), None)
                note = ", the only one, as the bounds are curved"
        if found is None:
            return {"status": "stuck", "family": "", "variables": [], "charts": [], "treatment": "its δ cannot be eliminated: no family"}
        data = found[0]
        if any(form(g, ONE, _chain(around, data.variables), data) is not None for form in self.closed):
            note = "; in closed form if what is integrated is a polynomial"
        charts = self._charts(g, data, around)
        by_formula = isinstance(data, Implicit) and all(c["how"] == "formula" for c in charts)
        return {
            "family": data.name,
            "variables": [v.name for v in data.variables],
            "charts": charts,
            "treatment": f"{'roots by formula' if by_formula else data.name}{_coordinates(data, charts)}{note}",
        }

    def _charts(self, g: Expr, data: object, around: Nest) -> list[Entry]:
        """Returns, for each eliminated variable, the number of roots and the way they are found."""
        if not isinstance(data, Implicit | Solvable):
            return []
        charts = []
        for v in reversed(data.variables):
            i = next((i for i in reversed(around) if i.var is v), None)
            bounds = (ZERO, ONE) if i is None else (i.lo, i.hi) if isinstance(data, Solvable) else widened(i.lo, i.hi)
            roots = solve(g, v, *bounds)
            formula = roots is not None and roots.certain
            count = len(roots.found) if roots is not None and formula else max_roots(g, v, self.max_roots)
            beyond = not formula and max_roots(g, v, self.max_roots + 1) > self.max_roots
            charts.append({"variable": v.name, "roots": count, "how": "formula" if formula else "isolated", "beyond": beyond})
        return charts

    # -- steps ---------------------------------------------------------------------------------------------------------

    def _differences(self, e: Expr, sign: int = 1) -> object:
        """Returns a key that is equal for expressions whose difference is free of variables."""
        a, b, c = (p.value(e) for p in self._along)
        return None if a is None or b is None or c is None else (sign * (a - b) % P, sign * (a - c) % P)

    def _with_steps_together(self, found: dict[tuple[Expr, str], Entry]) -> list[Entry]:
        floors: dict[object, Expr] = {}
        for node in postorder([rename_apart(with_floors(self.written))]):
            if is_step(node):
                for sign in (1, -1):
                    floors.setdefault(self._differences(cast(Expr, node.children[0]), sign), cast(Expr, node))
        entries: dict[object, Entry] = {}
        for (g, owner), entry in found.items():
            floor = floors.get(self._differences(g)) if floors and self._key(g) not in self._plain else None
            if floor is None:
                entries[g, owner] = entry
                continue
            key = (floor, owner, entry["status"], entry["family"])
            if key in entries:
                entries[key]["count"] += 1
            else:
                entries[key] = {**entry, "of": text_of(floor)}
        return list(entries.values())

    # -- surfaces without one ------------------------------------------------------------------------------------------

    def dropped(self) -> list[Entry]:
        """Returns the conditions of the program that became no surface of an integral, or the same one as another."""
        found = [
            entry_of(a.g, "", "parameters only", "parameters only: belongs to no integral, the derivative there is one-sided")
            for a in atoms_of(self.normal)
            if not a.g.free and a.resolution is None
        ]
        kept = {self._key(a.g) for a in atoms_of(self.before)}
        owners = {g: i for i in nests(self.apart) if isinstance(i, Integral) for g in owned_surfaces(i.body, i.var)}
        inside = {a for outer in self._conditions for a in atoms_of(outer.g)}
        first: dict[object, Expr] = {}
        for a, parts in self._conditions.items():
            if not parts and a.g.free:
                found.append(entry_of(a.g, "", "decided", "decided: it is the same everywhere"))
            for h in (h for h in parts if h.free):
                key = self._key(h)
                if key not in kept:
                    found.append(self._gone(h, owners.get(a.g), a in inside))
                elif len(parts) == 1 and first.setdefault(key, a.g) is not a.g:
                    found.append(entry_of(a.g, "", "identical", f"identical to {text_of(first[key])} = 0, and counted once"))
        return list({(d["surface"], d["treatment"]): d for d in found}.values())

    def _gone(self, h: Expr, owner: Integral | None, inside: bool) -> Entry:
        name = "" if owner is None else f"∫ d{owner.var.name}"
        if inside:
            return entry_of(h, name, "kink", "a kink inside another surface, which keeps it as |·|")
        for bound in () if owner is None else (owner.lo, owner.hi):
            x = cast(Integral, owner).var
            at_bound = cast(Expr, substitute(h, {x: bound}))
            if Shadow((x,)).degree(h) == 1 and all(p.value(at_bound) == 0 for p in self._points):
                return entry_of(h, name, "decided", f"the bound {x.name} = {text_of(bound)} decides it")
        return entry_of(h, name, "cancelled", "cancels: the simplified program does not depend on it")

    def _key(self, g: Expr) -> object:
        """Returns a key that is equal for proportional surfaces."""
        u, v = (p.value(g) for p in self._points)
        return divided(v, u) if u and v else g


def entry_of(g: Expr, owner: str, status: str, treatment: str) -> Entry:
    """Returns one surface as data."""
    return {
        "surface": f"{text_of(g)} = 0",
        "owner": owner,
        "status": status,
        "family": "",
        "variables": [],
        "charts": [],
        "parameters": [p.name for p in parameters(g)],
        "treatment": treatment,
        "count": 1,
        "of": "",
    }


def _chain(around: Nest, variables: Sequence[Var]) -> tuple[Binder, ...]:
    """Returns the integrals from the outermost one that takes part inwards."""
    first = next((k for k, i in enumerate(around) if i.var in variables), len(around))
    return tuple(Binder(i.var, i.lo, i.hi) for i in around[first:])


def _conditions(written: Expr) -> dict[Compare, list[Expr]]:
    """Returns the conditions without steps that a program was written with, and the canonical surfaces that each becomes by itself."""
    stepping = _holding_steps(written)
    atoms = [a for a in atoms_of(written) if a.resolution is None and a.g not in stepping]
    if not atoms:
        return {}
    brackets = cast(Tuple, canonicalise(tuple_of(*(where(a, ONE, ZERO) for a in atoms)))).children
    return {a: [h.g for h in atoms_of(e) if not h.g.free & binders_inside(e)] for a, e in zip(atoms, brackets, strict=True)}


def _holding_steps(root: Expr) -> set[Node]:
    """Returns the nodes with a floor, or another function with steps, of variables in them."""
    found: set[Node] = set()
    for node in postorder([root]):
        steps = isinstance(node, Call) and node.name in ("floor", "ceil", "round", "mod") and bool(node.free)
        if steps or any([c in found for c in node.children]):
            found.add(node)
    return found


def _coordinates(data: object, charts: Sequence[Entry]) -> str:
    """Returns the variables that a family eliminates, in words."""
    names = [v.name for v in reversed(cast(Any, data).variables)]
    match data:
        case Affine() if len(names) == 1:
            return f" in {names[0]}"
        case Affine():
            return f" in {', '.join(names)}: over the one with the largest |slope|·extent"
        case Bilinear():
            return f" in {', '.join(names)}: over {names[0]} where the curve is steeper in it, else over {names[1]}"
        case Solvable():
            return f": over {_roots(charts[0])}"
        case Implicit() if len(charts) == 1:
            return f": over {_roots(charts[0])}"
        case Implicit():
            return f": a chart over each of {' and '.join(_roots(c) for c in charts)}, weighted by slope"
        case Conic():
            return f" around the curve in {', '.join(names)}"
        case Mapped():
            return ""
        case _:
            return f": over {', '.join(names)}"


def _roots(chart: Entry) -> str:
    """Returns a variable, and its roots, in words."""
    most = "" if chart["how"] == "formula" else "≤ "
    if chart["beyond"]:
        return f"{chart['variable']} ({chart['roots']} roots at first, {chart['how']})"
    return f"{chart['variable']} ({most}{chart['roots']} root{'' if chart['roots'] == 1 else 's'}, {chart['how']})"
