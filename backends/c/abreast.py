"""Integrands at eight nodes of a rule side by side: a loop without branches and calls, of which compilers make vector code.

The nodes of an interval are placed first, then the integrand is computed at all of them, then its values are added up:

    places     at[k], by[k]              a node, and what its weight is multiplied by
    values     values[N*j + k]           value j at node k of N, a multiple of eight; nodes beyond the last one repeat it
    f, slope   of node k                 as where an integrand is computed node by node

Sines and cosines of large angles have functions of their own, and ties are noted: where there is one of these among eight nodes, they are
computed one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count

from teg.backends.c.frame import Scope, Step, assignments
from teg.backends.c.lane_functions import BRANCHLESS as BRANCHLESS_IN_LANES
from teg.backends.c.lane_functions import SELECTIONS, values_in_lanes
from teg.backends.c.lanes import as_products
from teg.backends.c.text import identifiers, indent, packed
from teg.backends.lazily import COSTS, with_lazy_choices
from teg.program import Adaptive, Arg, Assign, Gauss, Integrate, Program

SIDE = 8
FEWEST = 5
"""Nodes of a rule for which it pays."""
LONGEST = 160
"""Statements of an integrand that is computed so."""
MODERATE = 280
"""The cost of an integrand, in additions, beyond which it is computed node by node if a choice then spares much of it."""
PLAIN = {"add", "sub", "mul", "neg", "const", "abs", "gt0", "ge0", "lt0", "le0", "and", "or", "not", "ok", "select", "min", "max"}
COSTLY = {"div", "sqrt", "exp", "expm1", "log", "sin", "cos", "powi"}
BRANCHLESS = BRANCHLESS_IN_LANES | {"log": "teg_log"}
EXCEPTIONAL = {"sin": "teg_sine", "cos": "teg_cosine", "tie": "gt0"}
"""What these are computed by where nothing is exceptional."""
MARK = "'"
"""Behind the names of an integrand that is computed at eight nodes."""


def is_abreast(stmt: Integrate) -> bool:
    """Returns whether an integrand is short arithmetic, with functions that have no branches, and a rule of enough nodes."""
    match stmt.rule:
        case Adaptive():
            many = not stmt.watch and not stmt.rule.closed
        case Gauss(nodes):
            many = nodes >= FEWEST
        case _:
            many = False
    ops = [s.op if isinstance(s, Assign) else "" for s in stmt.body]
    if not many or len(ops) > LONGEST or COSTLY.isdisjoint(ops) or not PLAIN.union(COSTLY, EXCEPTIONAL).issuperset(ops):
        return False
    if sum(COSTS.get(op, 1) for op in ops) <= MODERATE:
        return True
    lazy = with_lazy_choices(Program((), stmt.body, stmt.at_nodes))
    return all(isinstance(s, Assign) for s in lazy.body)


@dataclass(frozen=True, slots=True)
class Abreast:
    """An integrand at eight nodes: `steps` write `count` values at `place`. `capacity` is how many nodes an interval may have, rounded up
    to a multiple of eight. If it `has_exceptions`, the steps also write to `far` at which nodes there is one."""

    steps: list[Step]
    variables: dict[str, str]
    count: int
    capacity: int
    has_exceptions: bool

    def arrays(self) -> list[str]:
        """Returns declarations of the places and factors."""
        return [f"double at[{self.capacity}], by[{self.capacity}];"]


@dataclass(frozen=True, slots=True)
class Nodes:
    """The lines of such an integrand: `one` writes the values at x to `f`, `eight` those at `place` to `values`."""

    abreast: Abreast
    one: Sequence[str]
    eight: Sequence[str]

    def before(self, nodes: str, place: Sequence[str], factor: str) -> list[str]:
        """Returns lines that compute all values of an interval; `place` sets x and the factor of the node k."""
        n, count = self.abreast.capacity, self.abreast.count
        again = [
            "int some = 0;",
            f"for (int k = 0; k < {SIDE}; k++) some |= far[k];",
            f"for (int k = from; some && k < from + {SIDE}; k++) {{",
            *indent("x = at[k];", *self.one, f"for (int j = 0; j < {count}; j++) values[{n} * j + k] = f[j];"),
            "}",
        ]
        return [
            f"for (int k = 0; k < {nodes}; k++) {{",
            *indent(*place, "at[k] = x;", f"by[k] = {factor};"),
            "}",
            *([] if nodes == str(n) else [f"for (int k = {nodes}; k < {n}; k++) at[k] = x;"]),
            f"for (int from = 0; from < {nodes}; from += {SIDE}) {{",
            *indent(
                *([f"int far[{SIDE}];"] if self.abreast.has_exceptions else []),
                f"for (int k = 0; k < {SIDE}; k++) {{",
                *indent(*(["const double place = at[from + k];"] if "place" in identifiers("\n".join(self.eight)) else []), *self.eight),
                "}",
                *(again if self.abreast.has_exceptions else []),
            ),
            "}",
        ]

    def at_node(self, factor: str) -> list[str]:
        """Returns lines that set the factor and `f` of node k."""
        n, count = self.abreast.capacity, self.abreast.count
        return [f"const double {factor} = by[k];", f"for (int j = 0; j < {count}; j++) f[j] = values[{n} * j + k];"]


def eight_at_once(stmt: Integrate) -> Abreast:
    """Returns an integrand at eight nodes, with names of its own."""
    assert isinstance(stmt.rule, Adaptive | Gauss)
    most = stmt.rule.nodes if isinstance(stmt.rule, Gauss) else max(stmt.rule.first, stmt.rule.order)
    capacity = -(-most // SIDE) * SIDE
    body = [s for s in stmt.body if isinstance(s, Assign)]
    own = {s.name for s in body} | {stmt.var}
    moving = values_in_lanes(body, {stmt.var})

    def renamed(arg: Arg) -> Arg:
        return arg + MARK if isinstance(arg, str) and arg in own else arg

    steps: list[Step] = []
    names = (f"v{n}{MARK}{MARK}" for n in count())
    for s in body:
        shared = s.op == "select" and s.args[0] not in moving
        op = "teg_pick" if shared else EXCEPTIONAL.get(s.op, BRANCHLESS.get(s.op, s.op))
        args = s.args[:1] if s.op == "tie" else s.args
        made = replace(s, name=s.name + MARK, op=op, args=tuple(map(renamed, args)))
        lines = as_products(made, names) if s.op == "powi" else (made,)
        steps += [step for line in lines for step in assignments(line)]
    for step in steps:
        if step.assign is not None and step.assign.op in SELECTIONS:
            step.longest = 0  # all operands are computed
    angles = tuple(dict.fromkeys(renamed(s.args[0]) for s in body if s.op in ("sin", "cos")))
    ties = tuple(renamed(arg) for s in body if s.op == "tie" for arg in s.args[:2])
    if angles or ties:
        steps.append(Step((), (*angles, *ties), lines=partial(_exceptions, angles, ties)))
    values = tuple(map(renamed, stmt.at_nodes))
    steps.append(Step((), values, lines=partial(_written, values, capacity), weight=len(values)))
    return Abreast(steps, {stmt.var + MARK: "place"}, len(values), capacity, bool(angles or ties))


def _exceptions(angles: Sequence[Arg], ties: Sequence[Arg], scope: Scope) -> list[str]:
    found = [f"!teg_near_turns({scope(a)})" for a in angles]
    found += [f"(fabs({scope(g)}) <= TEG_TIE_EPS * ({scope(scale)}))" for g, scale in zip(ties[::2], ties[1::2], strict=True)]
    return packed([f"far[k] = {found[0]};", *(f"far[k] |= {more};" for more in found[1:])])


def _written(values: Sequence[Arg], apart: int, scope: Scope) -> list[str]:
    return packed(f"values[{apart * j} + from + k] = {scope(value)};" for j, value in enumerate(values))
