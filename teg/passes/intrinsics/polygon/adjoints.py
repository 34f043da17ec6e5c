"""Derivatives by the inputs of a loop, and the chain rule once behind it.

    Σ over boxes of  outputs of a flat program    →    Σ over boxes of *moments*;   outputs = matrix · sums of moments

The integrand of every derivative of one integral over a polygon is a polynomial. In coordinates that all boxes of a loop share, its
coefficients are the same for all of them, but for the data of a box. So every output is a combination of few moments with coefficients
that the loop does not change: the moments are added up, and the coefficients are applied once, behind the loop.

    coordinates    the barycentric ones of a polygon with corners; else its offsets from one point of the plane
    residuals      sums with data of a box in them, not expanded: small numbers stay small
    moments        products of residuals and coordinates under the integral; results of segments; other numbers, as they are

Whether a coefficient is 0 is decided in a finite field (`teg.program.residues`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import count

from teg.passes.intrinsics.polygon.polynomials import ONE, POINTS, Coefficient, Monomial, Poly, Polynomials, Steady, derivative
from teg.program import Arg, Assign, Polygon, Program, Segment, Stmt, assigned, statements
from teg.program.arrays import ArrayProgram, Loop, Number, Run, Step, steps
from teg.program.dce import without_dead_code
from teg.program.fields import result_names
from teg.program.joined import input_residues, joined
from teg.program.names import unused_numbers
from teg.program.residues import Residues
from teg.program.summed import Summed, summed, with_enclosing
from teg.program.walk import blocks, free_in

LEAST = 4
"""Outputs of a flat program for which moments are sought."""
MORE = 8
"""So many moments more than outputs may be added up."""

Moments = dict[Arg, Coefficient]
"""A combination of values of the flat program."""


class _Body:
    """The body of a polygon, to which values are added, each one once."""

    def __init__(self, lines: list[Stmt], name: Callable[[], str]) -> None:
        self.lines, self._name = lines, name
        self._known = {(s.op, s.args): s.name for s in lines if isinstance(s, Assign)}

    def value(self, op: str, *args: Arg) -> str:
        """Returns the name of a value."""
        if (op, args) not in self._known:
            self._known[op, args] = self._name()
            self.lines.append(Assign(self._known[op, args], op, args))
        return self._known[op, args]


class _Moments:
    """The outputs of a flat program as combinations of moments, and the program that computes these."""

    def __init__(self, run: Run, varying: set[Arg], indices: set[Arg], residues: Sequence[Residues], numbers: count[int]) -> None:
        self.run, self.indices, self._numbers = run, indices, numbers
        self.steady = Steady(numbers)
        self._residues = residues
        self._inputs = varying
        self.polynomials = self._polynomials()
        self.body: list[Stmt] = []
        self._of: dict[Arg, Moments] = {}
        self._nothing: set[Arg] = {0.0}
        """Values that are 0 or NaN."""
        self._selected: dict[tuple[Arg, ...], str] = {}
        self.found = False
        self._inside = self.polynomials

    def _polynomials(self) -> Polynomials:
        return Polynomials(self.steady, self._residues, set(self._inputs), set(self._inputs) - self.indices)

    def name(self) -> str:
        """Returns a name that is not used yet."""
        return f"v{next(self._numbers)}"

    def through(self) -> bool:
        """Goes through the program; returns whether every output is a combination, and moments of a polygon are among them."""
        for s in self.run.program.body:
            match s:
                case Polygon():
                    self.body += self._polygon(s)
                case Segment():
                    self.body.append(self._segment(s))
                case Assign():
                    self._assign(s)
                case _:
                    self.body.append(s)
                    self._mark([s])
        return self.found and all(self.of(o) is not None for o in self.run.program.outputs)

    def _mark(self, block: Iterable[Stmt]) -> None:
        """Notes which names vary."""
        varying = self.polynomials.varying
        for s in block:
            if not isinstance(s, Assign):
                varying.update(assigned(s), *(assigned(t) for inner in blocks(s) for t in statements(inner)))
            elif not varying.isdisjoint(s.args):
                varying.add(s.name)

    def of(self, arg: Arg) -> Moments | None:
        """Returns the combination that a value is; None if there is none."""
        if arg in self._of:
            return self._of[arg]
        return {arg: self.steady.number(1.0)} if arg in self.polynomials.varying else {} if arg == 0.0 else None

    def _assign(self, s: Assign) -> None:
        """Follows an assignment."""
        self.body.append(s)
        self._mark([s])
        self.polynomials.follow([s])
        if s.op == "select" and all(a in self._nothing or (isinstance(a, float) and a != a) for a in s.args[1:]):
            self._nothing.add(s.name)
        if self._of.keys().isdisjoint(s.args):
            return
        found = self._select(s) if s.op == "select" else self._times(s) if s.op == "mul" else None
        if s.op in ("add", "sub", "neg", "const"):
            signs = [-1.0 if s.op == "neg" or (s.op == "sub" and k == 1) else 1.0 for k in range(len(s.args))]
            parts = [(moments, self.steady.number(g)) for a, g in zip(s.args, signs, strict=True) if (moments := self.of(a)) is not None]
            found = self._total(parts) if len(parts) == len(s.args) else None
        if found is not None:
            self._of[s.name] = found

    def _total(self, parts: Iterable[tuple[Moments, Coefficient]]) -> Moments:
        result: Moments = {}
        for moments, factor in parts:
            for moment, c in moments.items():
                new = self.steady.mul(c, factor)
                both = self.steady.add(result[moment], new) if moment in result else new
                if both is None:
                    del result[moment]
                else:
                    result[moment] = both
        return result

    def _coefficient(self, arg: Arg) -> Coefficient | None:
        """Returns a value that the loop does not change."""
        if arg in self.polynomials.varying:
            return None
        found = self.polynomials.of(arg)
        return None if found is None else found.get(ONE, self.steady.number(0.0))

    def _times(self, s: Assign) -> Moments | None:
        """Returns a product of a combination and coefficients."""
        inside = [a for a in s.args if a in self.polynomials.varying]
        factors = [self._coefficient(a) for a in s.args if a not in inside]
        if len(inside) != 1 or None in factors:
            return None
        result = self._of.get(inside[0])
        for factor in factors:
            assert factor is not None
            result = None if result is None else self._total([(result, factor)])
        return result

    def _select(self, s: Assign) -> Moments | None:
        """Returns a selection between combinations, as one of selections between moments and nothing."""
        condition, *branches = s.args
        result: Moments = {}
        for k, branch in enumerate(branches):
            other = branches[1 - k]
            if branch in self._nothing:
                continue
            moments = self.of(branch)
            if moments is None:
                return None
            nothing = other if other in self._nothing else 0.0
            for moment, c in moments.items():
                args = (condition, moment, nothing) if k == 0 else (condition, nothing, moment)
                if args not in self._selected:
                    self._selected[args] = self.name()
                    self.body.append(Assign(self._selected[args], "select", args))
                    self.polynomials.varying.add(self._selected[args])
                result[self._selected[args]] = c
        return result

    # -- polygons and segments -----------------------------------------------------------------------------------------

    def _segment(self, s: Segment) -> Segment:
        """Returns a segment without the factors that are coefficients."""
        self._mark(s.setup)
        known: dict[tuple[Arg, Arg], str] = {}
        for result, value, factor in zip(s.results, s.values, s.factors, strict=True):
            c = self._coefficient(factor)
            moment = known.setdefault((value, factor if c is None else 1.0), self.name())
            self._of[result] = {moment: self.steady.number(1.0) if c is None else c}
        self.polynomials.varying.update(
            known.values(), s.results, (s.var,), (name for t in statements((*s.scales, *s.body)) for name in assigned(t))
        )
        return replace(s, values=tuple(v for v, _ in known), factors=tuple(f for _, f in known), results=tuple(known.values()))

    def _polygon(self, s: Polygon) -> list[Stmt]:
        """Returns a polygon whose values are moments, with what its coordinates are computed from."""
        self._mark(s.setup)
        before: list[Stmt] = []
        found = self._expanded(s, before)
        self.polynomials.varying.update(s.variables, s.results, (name for t in statements(s.body) for name in assigned(t)))
        if found is None:
            self._of |= {r: {r: self.steady.number(1.0)} for r in s.results}
            return [s]
        body, columns, coefficients = found
        results = [self.name() for _ in columns]
        self.polynomials.varying.update(results)
        for result, row, factor in zip(s.results, coefficients, s.factors, strict=True):
            c = self._coefficient(factor)
            assert c is not None
            self._of[result] = self._total([({results[k]: v for k, v in row.items()}, c)])
        self.found = True
        new = replace(s, body=body, values=tuple(columns), factors=(1.0,) * len(columns), results=tuple(results))
        return [*before, new]

    def _expanded(self, s: Polygon, before: list[Stmt]) -> tuple[tuple[Stmt, ...], list[Arg], list[dict[int, Coefficient]]] | None:
        """Returns the body of a polygon with its moments, and the coefficients of every value by the number of a moment; None if the values
        are no polynomials, or their coefficients change. What the coordinates are computed from is appended to `before`."""
        if any(self._coefficient(f) is None for f in s.factors) or not all(isinstance(t, Assign) for t in (*s.setup, *s.body)):
            return None
        names = self._coordinates(s, before)
        if names is None:
            return None
        values = self._values(s, names)
        if values is None:
            return None
        residuals = self._inside.residuals
        allowed = {*residuals, *names, *(s.variables[2:] if s.corners else s.variables)}
        if any(name not in allowed for p in values for m in p for name, _ in m):
            return None
        groups: dict[tuple[tuple[int, ...], ...], list[Monomial]] = {}
        for m in dict.fromkeys(m for p in values for m in p):
            key = tuple(p[m].residues if m in p else () for p in values)
            groups.setdefault(key, []).append(m)
        degrees = {name: max(sum(k for _, k in m) for m in p) for name, p in residuals.items()}
        if any(sum(k * degrees.get(name, 1) for name, k in m) > s.degree for g in groups.values() for m in g):
            return None
        body = _Body([*s.body, *(Assign(x, "add", (u, at)) for x, (u, at) in names.items())], self.name)
        columns = [self._moment(group, body) for group in groups.values()]
        rows = [{k: p[g[0]] for k, g in enumerate(groups.values()) if g[0] in p} for p in values]
        return tuple(body.lines), columns, rows

    def _moment(self, group: Sequence[Monomial], body: _Body) -> Arg:
        """Returns a sum of monomials."""
        terms: list[Arg] = []
        for m in group:
            factors = [name for name, k in m for _ in range(k)]
            while len(factors) > 1:
                factors[:2] = [body.value("mul", factors[0], factors[1])]
            terms.append(factors[0] if factors else 1.0)
        return terms[0] if len(terms) == 1 else body.value("add", *terms)

    def _values(self, s: Polygon, names: dict[str, tuple[str, str]]) -> list[Poly] | None:
        """Returns the values of a polygon as polynomials of its coordinates and residuals."""
        self._inside = inside = self._within(s)
        if s.corners:
            places = [[inside.of(at) for at in corner] for corner in s.corners]
            for axis, name in enumerate(s.variables[:2]):
                first, *others = (corner[axis] for corner in places)
                if first is None:
                    return None
                terms = [first]
                for coordinate, other in zip(s.variables[2:], others, strict=True):
                    step = None if other is None else inside.difference(other, first)
                    product = None if step is None else inside.product(step, inside.variable(coordinate))
                    if product is None:
                        return None
                    terms.append(product)
                inside.known[name] = inside.total(terms)
        for x, (u, at) in names.items():
            offset = inside.of(at)
            if offset is None:
                return None
            inside.known[u] = inside.difference(inside.variable(x), offset)
        inside.follow((*s.setup, *s.body), in_polygon=True)
        values = [inside.of(v) for v in s.values]
        whole = [v for v in values if v is not None]
        return whole if len(whole) == len(values) else None

    def _within(self, s: Polygon) -> Polynomials:
        """Returns the polynomials that are known outside of a polygon."""
        outside = self.polynomials
        inside = Polynomials(self.steady, self._residues, outside.varying | set(s.variables), set(outside.data))
        inside.known = dict(outside.known)
        return inside

    def _coordinates(self, s: Polygon, before: list[Stmt]) -> dict[str, tuple[str, str]] | None:
        """Returns coordinates x = u + (i - origin), by the variable u and the offset, of a polygon without corners: its values depend on
        u and on an index i of the loops by their sum alone. Other variables are coordinates themselves. None: a value is no polynomial."""
        if s.corners:
            return {}
        found = self._values(s, {})
        if found is None:
            return None
        polys = [*found, *self._inside.residuals.values()]
        names: dict[str, tuple[str, str]] = {}
        free = sorted(str(i) for i in self.indices)
        for u in s.variables:
            if not any(name == u for p in polys for m in p for name, _ in m):
                continue
            i = next((i for i in free if all(derivative(p, u) == derivative(p, i) for p in polys)), None)
            if i is None:
                continue
            free.remove(i)
            x, offset = self.name(), self.name()
            before.append(Assign(offset, "sub", (i, self._origin(s, i))))
            self.polynomials.follow(before[-1:])
            names[x] = (u, offset)
        return names

    def _origin(self, polygon: Polygon, index: str) -> Arg:
        """Returns a point near the boxes, along an index: one that the half-planes are written from, which pass through the boxes. Else any
        other such point, or 0: the values are then written in these coordinates, too."""
        lines = [s for s in self.run.program.body if isinstance(s, Assign)]
        near = without_dead_code(Program((), tuple(lines), tuple(g.c for g in polygon.half_planes))).body
        for s in (*near, *lines):
            if isinstance(s, Assign) and s.op in ("add", "sub") and len(s.args) == 2 and index in s.args:
                other = s.args[1 if s.args[0] == index else 0]
                if s.op == "sub" and other not in self.polynomials.varying:
                    return other
                if s.op == "add" and isinstance(other, float):
                    return -other
        return 0.0


def with_adjoints(program: ArrayProgram) -> ArrayProgram:
    """Returns the program in which loops over boxes add up moments, where all that they give is combinations of not many more."""
    numbers = unused_numbers(n for s in steps(program.body) for n in result_names(s))
    candidates: list[tuple[Summed, Run]] = []
    for loop, around in with_enclosing(program.body):
        runs = [s for s in loop.body if isinstance(s, Run)]
        if len(runs) != 1 or any(isinstance(s, Loop) for s in loop.body):
            continue
        found = summed(loop, runs[0], around)
        if found and len(found.run.results) >= LEAST and not found.after:
            candidates.append((found, joined(found.run, found.makers)))
    connected = [input_residues(program.body, [run for _, run in candidates], point) for point in range(POINTS)] if candidates else []
    changes: dict[int, tuple[Step, ...]] = {}
    for found, run in candidates:
        if made := _split(found, run, [Residues(known[id(run)]) for known in connected], numbers):
            changes[id(found.carrier)] = made
    return replace(program, body=_replaced(program.body, changes)) if changes else program


def _replaced(block: tuple[Step, ...], changes: dict[int, tuple[Step, ...]]) -> tuple[Step, ...]:
    """Returns a block with some loops replaced. Recursion is as deep as loops are."""
    result: list[Step] = []
    for s in block:
        if id(s) in changes:
            result += changes[id(s)]
        else:
            result.append(replace(s, body=_replaced(s.body, changes)) if isinstance(s, Loop) else s)
    return tuple(result)


def _split(found: Summed, run: Run, residues: Sequence[Residues], numbers: count[int]) -> tuple[Step, ...] | None:
    """Returns a carrier with moments in place of the outputs of a flat program, and the flat program that combines them."""
    inside = found.names
    varying: set[Arg] = {f"p{i}" for i, a in enumerate(run.inputs) if a in inside}
    counted = {s.name for s in steps(found.carrier.body) if isinstance(s, Number)}
    indices: set[Arg] = {f"p{i}" for i, a in enumerate(run.inputs) if a in counted}
    block = list(statements(run.program.body))
    for r in residues:
        r.follow(block)
    inner = unused_numbers(n for s in block for n in assigned(s))
    moments = _Moments(run, varying, indices, residues, inner)
    if not moments.through():
        return None
    wanted = [moments.of(v) or {} for v in run.program.outputs]
    distinct = list(dict.fromkeys(moment for row in wanted for moment in row))
    if all(c.arg == 1.0 for row in wanted for c in row.values()):
        return None
    outputs = dict(zip(run.results, wanted, strict=True))
    shorter = without_dead_code(replace(run.program, body=tuple(moments.body), outputs=tuple(distinct)))
    own = {f"p{i}" for i in range(len(run.inputs))}
    if len(distinct) > len(run.results) + MORE or not own.union(*map(assigned, shorter.body)).issuperset(
        [*free_in(shorter.body), *distinct]
    ):
        return None
    results = tuple(f"v{next(numbers)}" for _ in distinct)
    sums = tuple(f"v{next(numbers)}" for _ in distinct)
    rows = [outputs[str(v)] for _, v in found.sums]
    matrix = _matrix(moments, rows, distinct, len(run.inputs))
    if matrix is None:
        return None
    carrier = _with_moments(found, Run(shorter, run.inputs, results), sums, numbers)
    behind = Run(matrix[0], tuple(run.inputs[i] for i in matrix[1]) + sums, tuple(r for r, _ in found.sums))
    return carrier, behind


def _matrix(moments: _Moments, rows: Sequence[Moments], distinct: Sequence[Arg], inputs: int) -> tuple[Program, list[int]] | None:
    """Returns the program of the combinations, and which inputs it has before the sums of the moments. A moment that is 0 everywhere adds
    nothing, whatever its coefficient is."""
    body = [s for s in statements(moments.run.program.body) if isinstance(s, Assign) and s.name not in moments.polynomials.varying]
    body += moments.steady.lines
    sums = {moment: f"p{inputs + k}" for k, moment in enumerate(distinct)}
    empty: dict[Arg, str] = {}
    for moment, total in sums.items():
        size, empty[moment] = moments.name(), "b" + moments.name()[1:]
        body += [Assign(size, "abs", (total,)), Assign(empty[moment], "le0", (size,))]
    outputs: list[Arg] = []
    for row in rows:
        terms: list[Arg] = []
        for moment, (c, _) in row.items():
            product, term = moments.name(), moments.name()
            if c == 1.0:
                terms.append(sums[moment])
                continue
            body += [Assign(product, "mul", (c, sums[moment])), Assign(term, "select", (empty[moment], 0.0, product))]
            terms.append(term)
        outputs.append(moments.name() if len(terms) > 1 else terms[0] if terms else 0.0)
        body += [Assign(str(outputs[-1]), "add", tuple(terms))] if len(terms) > 1 else []
    names = tuple(f"p{i}" for i in range(inputs + len(distinct)))
    program = without_dead_code(Program(names, tuple(body), tuple(outputs)))
    read = {a for s in program.body if isinstance(s, Assign) for a in s.args} | set(program.outputs)
    if any(isinstance(s, Assign) and s.op in ("call", "tie") for s in program.body):
        return None
    kept = [i for i in range(inputs) if f"p{i}" in read]
    new: dict[Arg, Arg] = {f"p{i}": f"p{k}" for k, i in enumerate([*kept, *range(inputs, inputs + len(distinct))])}
    renamed = tuple(replace(s, args=tuple(new.get(a, a) for a in s.args)) for s in program.body if isinstance(s, Assign))
    parameters = tuple(f"{k}" for k in range(len(new)))
    return Program(parameters, renamed, tuple(new.get(o, o) for o in program.outputs)), kept


def _with_moments(found: Summed, run: Run, sums: Sequence[str], numbers: count[int]) -> Loop:
    """Returns the carrier with another flat program in the innermost loop, whose results are summed up to `sums`."""
    only = found.run
    dropped, inner = set(only.results), run.results
    below: tuple[Step, Step] = (only, run)
    for depth, loop in reversed(list(enumerate(found.chain))):
        pairs = list(zip(loop.results, loop.values, strict=True))
        kept = [(r, v) for r, v in pairs if v not in dropped]
        names = tuple(sums) if depth == 0 else tuple(f"v{next(numbers)}" for _ in inner)
        kept += zip(names, inner, strict=True)
        old, new = below
        body = tuple(new if s is old else s for s in loop.body)
        below = (loop, replace(loop, body=body, results=tuple(r for r, _ in kept), values=tuple(v for _, v in kept)))
        dropped, inner = {r for r, v in pairs if v in dropped}, names
    made = below[1]
    assert isinstance(made, Loop)
    return made
