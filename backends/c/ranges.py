"""Which iterations of a loop can have a result other than 0, and which are on the straight line, from the first and the last one.

    live     =  g ≥ 0 & h ≥ 0 & …        g and h affine in the index, or convex
    covered  =  u > 0 & v > 0 & …        u and v affine in the index, or concave

Between two iterations a convex number is below the straight line through both, and a concave one above it. So an iteration whose line is
negative is not live, one whose lines are positive is covered, and the ends of both ranges follow from two values of each number. What is
live but not covered is crossed by a surface.

    narrowing(found, indices)  ->  Narrowing        what must not be negative, and what is positive where nothing passes
    function                   ->  a C function of these numbers at one iteration

Decisions allow for rounding errors: live is g + |…| ≥ 0, covered g - |…| > 0. A number that is convex by such a term, and should be
concave, is replaced by what it is without the term, which is less.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from teg.backends.c.frame import Frame, Spelling, assignments, captured_by
from teg.backends.c.lanes import Packed
from teg.backends.c.text import TRUTH
from teg.program import Arg, Assign, Program
from teg.program.dce import without_dead_code
from teg.program.names import is_number, is_parameter, parameter_numbers, unused_numbers


@dataclass(frozen=True, slots=True)
class Narrowing:
    """Numbers that are not negative in an iteration that is live, unless one of some conditions holds, which are the same for all of them;
    `exact` if an iteration in which none is negative is live. Numbers `covers` that all are positive in iterations on the straight line,
    provided that some conditions hold; no number if that is not known. `planes` has the places among these of the numbers that are positive
    where a half-plane holds; none if one is not there. And the statements that compute all of them."""

    heights: tuple[str, ...]
    unless: tuple[str, ...]
    exact: bool
    covers: tuple[str, ...]
    provided: tuple[str, ...]
    planes: tuple[int, ...]
    body: tuple[Assign, ...]

    @property
    def decides(self) -> bool:
        """Returns whether the heights alone tell which iterations are live."""
        return self.exact and not self.unless

    @property
    def inputs(self) -> list[int]:
        """Returns the numbers of the parameters that are read."""
        used = {a for s in self.body for a in s.args}
        return parameter_numbers(used)


class _Bend(NamedTuple):
    """How a number depends on the index; it is affine if it is convex and concave."""

    convex: bool
    concave: bool
    steady: bool

    def times(self, sign: float) -> _Bend:
        """Returns the bend of a multiple."""
        return self if sign >= 0.0 else _Bend(self.concave, self.convex, self.steady)


STEADY, AFFINE, OTHER = _Bend(True, True, True), _Bend(True, True, False), _Bend(False, False, False)


class _Required(NamedTuple):
    """What holds where a condition does: numbers that are not negative; or one of the conditions `unless`. `exact` if the condition holds
    wherever that does."""

    heights: dict[str, None]
    unless: dict[str, None]
    exact: bool = True


def narrowing(found: Packed, indices: Collection[Arg], varying: Collection[Arg]) -> Narrowing | None:
    """Returns what must not be negative; None if nothing is known. `indices` are the parameters that are the index of the loop, `varying`
    all that change in it."""
    if not isinstance(found.live, str):
        return None
    bends: dict[Arg, _Bend] = dict.fromkeys(varying, OTHER) | dict.fromkeys(indices, AFFINE)
    for s in found.settling:
        bends[s.name] = _bend(s, bends)
    required = _required(found.live, {s.name: s for s in found.settling}, bends)
    if required is None or not required.heights:
        return None
    heights, unless = tuple(required.heights), tuple(required.unless)
    statements = list({s.name: s for s in (*found.settling, *found.deciding)}.values())
    covers, provided = _covering(found, required, statements, bends)
    body = without_dead_code(Program((), tuple(statements), (*heights, *unless, *covers, *provided))).body
    planes = tuple(covers.index(g) for g in found.planes if isinstance(g, str) and g in covers)
    planes = planes if len(planes) == len(found.planes) else ()
    return Narrowing(heights, unless, required.exact, covers, provided, planes, tuple(s for s in body if isinstance(s, Assign)))


def _bend(s: Assign, bends: dict[Arg, _Bend]) -> _Bend:
    """Returns how a statement's number depends on the index."""
    args = [bends.get(a, STEADY) for a in s.args]
    if all(a.steady for a in args):
        return STEADY
    match s.op:
        case "add" | "const":
            return _sum(args)
        case "sub":
            return _sum([args[0], args[1].times(-1.0)])
        case "neg":
            return args[0].times(-1.0)
        case "mul":
            changing = [a for a in args if not a.steady]
            known = [float(a) for a in s.args if not isinstance(a, str)]
            if len(changing) > 1:
                return OTHER
            if len(known) == len(args) - 1:
                sign = 1.0
                for factor in known:
                    sign *= factor
                return changing[0].times(sign)
            return changing[0] if changing[0] == AFFINE else OTHER
        case "abs":
            return _Bend(True, False, False) if args[0] == AFFINE else OTHER
        case _:
            return OTHER


def _sum(parts: Iterable[_Bend]) -> _Bend:
    parts = list(parts)
    return _Bend(all(p.convex for p in parts), all(p.concave for p in parts), False)


def _required(condition: str, made: dict[str, Assign], bends: dict[Arg, _Bend]) -> _Required | None:
    """Returns what a condition requires, or what its negation does, for all conditions from the first statement on."""
    known: dict[tuple[str, bool], _Required | None] = {}
    stack = [(condition, True)]
    while stack:
        key = stack[-1]
        name, holds = key
        s = made.get(name)
        if key in known:
            stack.pop()
            continue
        inside: list[tuple[str, bool]] = []
        if s is not None and s.op in ("and", "or", "not"):
            inside = [(a, holds != (s.op == "not")) for a in s.args if isinstance(a, str)]
        missing = [k for k in inside if k not in known]
        if missing:
            stack += missing
            continue
        stack.pop()
        parts = [known[k] for k in inside]
        if bends.get(name, STEADY).steady:
            known[key] = _Required({}, {name: None}) if holds else None
        elif s is None:
            known[key] = None
        elif s.op == "not":
            known[key] = parts[0]
        elif s.op in ("and", "or") and len(inside) == len(s.args):
            known[key] = _all(parts) if (s.op == "and") == holds else _any(parts)
        else:
            known[key] = _of_comparison(s, holds, bends)
    return known[condition, True]


def _of_comparison(s: Assign, holds: bool, bends: dict[Arg, _Bend]) -> _Required | None:
    """Returns the number that is not negative where a comparison holds, or does not."""
    upwards = s.op in ("gt0", "ge0")
    if s.op not in ("gt0", "ge0", "lt0", "le0") or upwards != holds or not isinstance(s.args[0], str):
        return None
    return _Required({s.args[0]: None}, {}) if bends.get(s.args[0], STEADY).convex else None


def _all(parts: Iterable[_Required | None]) -> _Required | None:
    """Returns what several conditions require together."""
    parts = list(parts)
    useful = [p for p in parts if p is not None and p.heights and not p.unless]
    if not useful:
        return None
    return _Required({h: None for p in useful for h in p.heights}, {}, len(useful) == len(parts) and all(p.exact for p in useful))


def _any(parts: Iterable[_Required | None]) -> _Required | None:
    """Returns what each one of several conditions requires."""
    known = list(parts)
    if any(p is None for p in known):
        return None
    moving = [p for p in known if p is not None and p.heights]
    unless = {c: None for p in known if p is not None for c in p.unless}
    if not moving:
        return _Required({}, unless)
    return _Required({h: None for h in moving[0].heights if all(h in p.heights for p in moving)}, unless, len(known) == 1)


# -- what covers iterations ----------------------------------------------------------------------------------------------


class _Enough(NamedTuple):
    """A condition holds where these numbers, each with its sign, are positive, provided that some conditions of all iterations hold; each
    of those with whether it must hold or must not."""

    positive: dict[tuple[str, float], None]
    provided: dict[tuple[str, bool], None]


def _covering(
    found: Packed, required: _Required, statements: list[Assign], bends: dict[Arg, _Bend]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Returns numbers and conditions that are enough for an iteration to be live and fast; appends what computes them to the statements."""
    if not isinstance(found.fast, str) or not isinstance(found.live, str):
        return (), ()
    for s in statements:
        bends.setdefault(s.name, _bend(s, bends))
    made = {s.name: s for s in statements}
    ruled_out = {(name, -1.0) for name in required.heights}
    parts = [_enough(condition, made, bends, ruled_out) for condition in (found.fast, found.live)]
    if any(p is None for p in parts):
        return (), ()
    numbers = unused_numbers(a for s in statements for a in (s.name, *s.args) if isinstance(a, str))
    below = {s.name: f"v{next(numbers)}" for s in statements if is_number(s.name) and not bends[s.name].steady}

    def new(op: str, name: str, letter: str) -> str:
        statements.append(Assign(f"{letter}{next(numbers)}", op, (name,)))
        return statements[-1].name

    for s in tuple(statements):  # what numbers are without their absolute values
        if s.name in below:
            args = tuple(below.get(a, a) if isinstance(a, str) else a for a in s.args)
            statements.append(Assign(below[s.name], *(("const", (0.0,)) if s.op == "abs" else (s.op, args))))
    covers: dict[str, None] = {}
    provided: dict[str, None] = {}
    for part in parts:
        for name, sign in part.positive if part else ():
            least = name if bends[name].times(sign).concave else below[name]
            covers[least if sign > 0 else new("neg", least, "v")] = None
        for name, holds in part.provided if part else ():
            provided[name if holds else new("not", name, "b")] = None
    return tuple(covers), tuple(provided)


def _enough(condition: str, made: dict[str, Assign], bends: dict[Arg, _Bend], ruled_out: set[tuple[str, float]]) -> _Enough | None:
    """Returns what is enough for a condition, or for its negation, for all conditions from the first statement on. Numbers with signs that
    are `ruled_out` are not positive anyway."""
    known: dict[tuple[str, bool], _Enough | None] = {}
    stack = [(condition, True)]
    while stack:
        key = stack[-1]
        name, holds = key
        s = made.get(name)
        inside: list[tuple[str, bool]] = []
        if s is not None and s.op in ("and", "or", "not") and not bends[name].steady:
            inside = [(a, holds != (s.op == "not")) for a in s.args if isinstance(a, str)]
        missing = [k for k in inside if k not in known]
        if key not in known and missing:
            stack += missing
            continue
        stack.pop()
        parts = [known[k] for k in inside]
        if key in known:
            continue
        if bends.get(name, STEADY).steady:
            known[key] = _Enough({}, {(name, holds): None})
        elif s is None or len(inside) < len(s.args if s.op in ("and", "or", "not") else ()):
            known[key] = None
        elif (s.op == "or" and holds) or (s.op == "and" and not holds):
            known[key] = max((p for p in parts if p is not None), key=lambda p: bool(p.positive), default=None)
        elif inside:
            whole = [p for p in parts if p is not None]
            positive, provided = {k: None for p in whole for k in p.positive}, {k: None for p in whole for k in p.provided}
            known[key] = _Enough(positive, provided) if len(whole) == len(parts) else None
        else:
            found = _enough_to_compare(s, holds, bends)
            known[key] = found if found is None or ruled_out.isdisjoint(found.positive) else None
    return known[condition, True]


def _enough_to_compare(s: Assign, holds: bool, bends: dict[Arg, _Bend]) -> _Enough | None:
    """Returns the number that is positive where a comparison holds, or does not: it or what is less is concave."""
    name = s.args[0]
    if s.op not in ("gt0", "ge0", "lt0", "le0") or not isinstance(name, str) or name not in bends:
        return None
    sign = 1.0 if (s.op in ("gt0", "ge0")) == holds else -1.0
    bend = bends[name].times(sign)
    return _Enough({(name, sign): None}, {}) if bend.convex or bend.concave else None


def function(found: Narrowing) -> list[str]:
    """Returns the inside of the C function of one iteration: it writes the numbers to `height`, those that cover behind the others, and
    returns 1 if the others decide nothing, plus 2 if nothing is covered."""
    steps = [step for s in found.body for step in assignments(s)]
    own: list[Arg] = [*found.heights, *found.unless, *found.covers, *found.provided]
    names = {name: name for name in captured_by(own, steps, ()) if isinstance(name, str)}
    frame = Frame([], [steps], own, False, {n: n for n in names if is_parameter(n)}, Spelling(whole=(0,), truth=TRUTH))
    lines = frame.block(0)
    scope = frame.scope()
    lines += [f"height[{m}] = {scope(h)};" for m, h in enumerate((*found.heights, *found.covers))]
    told = [f"({scope(c)})" for c in found.unless] + [f"(!({scope(c)}) << 1)" for c in found.provided]
    return [*lines, f"return {' | '.join(told) or '0'};"]
