"""Which iterations of a loop can have a result other than 0, from the first and the last one.

    live  =  g ≥ 0 & h ≥ 0 & …        g and h affine in the index, or convex

Between two iterations a convex number is below the straight line through both. So an iteration whose line is negative is not live, and
the ends of what is left follow from two values of each number. Rounded outwards by one iteration.

    narrowing(found, indices)  ->  Narrowing        what must not be negative
    function                   ->  a C function of these numbers at one iteration
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from teg.backends.c.frame import Frame, assignments, captured_by
from teg.backends.c.lanes import Packed
from teg.program import Arg, Assign, Program
from teg.program.dce import without_dead_code


@dataclass(frozen=True, slots=True)
class Narrowing:
    """Numbers that are not negative in an iteration that is live, unless one of some conditions holds, which are the same for all of them;
    and the statements that compute both."""

    heights: tuple[str, ...]
    unless: tuple[str, ...]
    body: tuple[Assign, ...]

    @property
    def inputs(self) -> list[int]:
        """Returns the numbers of the parameters that are read."""
        used = {a for s in self.body for a in s.args}
        return sorted(int(a[1:]) for a in used if isinstance(a, str) and a[0] == "p")


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
    """What holds where a condition does: numbers that are not negative; or one of the conditions `unless`."""

    heights: dict[str, None]
    unless: dict[str, None]


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
    body = without_dead_code(Program((), found.settling, (*heights, *unless))).body
    return Narrowing(heights, unless, tuple(s for s in body if isinstance(s, Assign)))


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
    useful = [p for p in parts if p is not None and p.heights and not p.unless]
    if not useful:
        return None
    return _Required({h: None for p in useful for h in p.heights}, {})


def _any(parts: Iterable[_Required | None]) -> _Required | None:
    """Returns what each one of several conditions requires."""
    known = list(parts)
    if any(p is None for p in known):
        return None
    moving = [p for p in known if p is not None and p.heights]
    unless = {c: None for p in known if p is not None for c in p.unless}
    if not moving:
        return _Required({}, unless)
    return _Required({h: None for h in moving[0].heights if all(h in p.heights for p in moving)}, unless)


def function(found: Narrowing) -> list[str]:
    """Returns the inside of the C function of one iteration: it writes the numbers to `height`, and returns whether they decide nothing."""
    steps = [step for s in found.body for step in assignments(s)]
    own: list[Arg] = [*found.heights, *found.unless]
    names = {name: name for name in captured_by(own, steps, ()) if isinstance(name, str)}
    frame = Frame([], [steps], own, False, {n: n for n in names if n[0] == "p"}, whole=(0,))
    lines = frame.block(0)
    scope = frame.scope()
    lines += [f"height[{m}] = {scope(h)};" for m, h in enumerate(found.heights)]
    return [*lines, f"return {' || '.join(scope(c) for c in found.unless) or '0'};"]
