"""One C function in the making: what its names are called, which of them live in the workspace, where it is cut.

A value that is used once, in the block and the C function that compute it, has no name: it is printed where it is used.

A `Step` declares everything its lines read: `uses` (values and captured literals, spelled), `stored` (values read from the workspace) and
`locals` (C variables of the function that are no values). The parameters and loads of a part follow from these declarations alone. A
`Scope` refuses to spell an argument that the step being printed does not declare.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from teg.backends.c.text import ATOM, NEUTRAL, Text, expression, indent, kind, literal, packed, wrapped
from teg.program import Arg, Assign

PART = 400  # statements in one C function, beyond which a block is cut
BY_VALUE = 40  # captured values passed as C arguments; more go through the workspace
ON_STACK = 64  # results of an integral kept in arrays on the C stack
ARITY = 64  # operands in one C expression
LITERALS = 24  # captured literals; a routine with more keeps them in its text
INLINE = 84  # characters of an expression printed where it is used
ARGUMENT = 32  # … as an argument of an integral


class Local(NamedTuple):
    """A C variable of a function that is not a value of the program: its declaration as a parameter, without the name, and its name."""

    type: str
    name: str


WORKSPACE, RESULTS, CONTEXT = Local("double *", "w"), Local("double *", "f"), Local("teg_context *", "ctx")
SUMS, WEIGHT = Local("double *", "s"), Local("double ", "weight")
LOCALS = (WORKSPACE, RESULTS, SUMS, WEIGHT, CONTEXT)
"""In the order in which a part takes them."""


@dataclass(slots=True, eq=False)  # not frozen: that takes twice as long to make, and a program has many
class Step:
    """An assignment, or C lines given a Scope that spells names; `area` doubles are used beyond the frame's own workspace.

    `uses` has an argument as often as it is spelled, `longest` is what may be printed in its place; `stored` are read from the workspace;
    `locals` are the C variables of the function that the lines name, but for the workspace of values that are loaded or kept.
    """

    defines: tuple[str, ...]
    uses: tuple[Arg, ...]
    assign: Assign | None = None
    lines: Callable[[Scope], list[str]] | None = None
    weight: int = 1
    area: int = 0
    longest: int = INLINE
    stored: tuple[str, ...] = ()
    locals: tuple[Local, ...] = ()


@dataclass(slots=True)
class Scope:
    """The spelling of names and literals at one place; the workspace of called routines begins at `free`. Arguments are spelled if they are
    `declared` (None: all of them), or were named in this scope since."""

    names: dict[Arg, str]
    free: int
    elsewhere: dict[Arg, str] = field(default_factory=dict)
    waiting: dict[Arg, Text] = field(default_factory=dict)  # values to be printed where they are used
    count: list[int] = field(default_factory=lambda: [0])
    slots: dict[Arg, int] = field(default_factory=dict)
    declared: Collection[Arg] | None = None
    lanes: Collection[Arg] = ()  # those with a value for each of the points that are computed side by side
    truth: str = "int"  # the C type of conditions

    def __call__(self, arg: Arg) -> str:
        return self.spell(arg).text

    def spell(self, arg: Arg) -> Text:
        known = isinstance(arg, str) or (not isinstance(arg, bool) and float(arg) in self.names)  # other literals stand in the text
        assert not known or self.declared is None or arg in self.declared, f"{arg} is spelled by a step that does not declare it"
        if isinstance(arg, str):
            return self.waiting.get(arg) or Text(self.elsewhere.get(arg) or self.names[arg], ATOM)
        if isinstance(arg, bool):
            return Text(str(int(arg)), ATOM)
        return Text(self.names.get(float(arg)) or literal(float(arg)), ATOM)

    def kind(self, arg: Arg) -> str:
        """Returns the C type of a value."""
        return "teg_lanes_8" if arg in self.lanes else self.truth if kind(arg) == "int" else kind(arg)

    def name(self, value: str, letter: str = "") -> str:
        """Returns a new name for a value."""
        self.count[0] += 1
        self.names[value] = f"{letter or ('b' if value[0] == 'b' else 'v')}{self.count[0]}"
        return self.names[value]


@dataclass(frozen=True, slots=True)
class Spelling:
    """How a C function is spelled: what the names of captured values begin with, how many of them are passed
    `by_value` (None: BY_VALUE), which blocks, by
    their numbers, must stay `whole`, which values are several numbers side by side, in `lanes`, and the C type of conditions."""

    prefix: str = "c"
    by_value: int | None = None
    whole: Container[int] = ()
    lanes: Collection[Arg] = ()
    truth: str = "int"


PLAIN = Spelling()


class Frame:
    """A C function; a part is a C function of its own that runs a stretch of a long block; part 0 is the function itself. `own` are the
    arguments that the function spells between its blocks."""

    def __init__(
        self,
        captured: Sequence[Arg],
        blocks: list[list[Step]],
        own: Sequence[Arg],
        context: bool,
        variables: dict[str, str] | None = None,
        spelling: Spelling = PLAIN,
    ) -> None:
        steps = [step for block in blocks for step in block]
        self.captured, self.blocks, self.context, self.variables = captured, blocks, context, variables or {}
        self.indirect = len(captured) > (BY_VALUE if spelling.by_value is None else spelling.by_value)
        self.below = max((step.area for step in steps), default=0)
        self.names: dict[Arg, str] = {arg: f"{spelling.prefix}{i}" for i, arg in enumerate(captured)}
        self.names.update(self.variables)
        self.parts: list[str] = []  # their texts
        self.count = [0]
        self._cuts = _cut(blocks, spelling.whole)
        self._between, self._spelling = frozenset(own), spelling
        known: set[Arg] = set(self.names)
        times: dict[Arg, int] = {}  # how often a name is spelled
        stored: dict[Arg, None] = {}
        for step in steps:
            known.update(step.defines)
            for arg in step.uses:
                times[arg] = times.get(arg, 0) + 1
            if step.stored:
                stored |= dict.fromkeys(step.stored)
        self._home: dict[Arg, int] = {}  # the part that defines a name, if it is not part 0
        self._slots: dict[Arg, int] = {arg: i for i, arg in enumerate(captured)} if self.indirect else {}
        self._uses = {0: dict.fromkeys(arg for arg in own if arg in known)}  # by part
        for number, part in (numbered for cut in self._cuts for numbered in cut):
            if number:
                self._home |= dict.fromkeys((name for step in part for name in step.defines), number)
            uses = self._uses.setdefault(number, {})
            uses |= dict.fromkeys(arg for step in part for arg in step.uses if arg in known)
        for number, uses in self._uses.items():
            for arg in uses:
                if self._home.get(arg, 0) != number:
                    self._slots.setdefault(arg, len(self._slots))
        for arg in stored:
            self._slots.setdefault(arg, len(self._slots))
        self._own = {arg for arg in self._uses[0] if arg not in self._home}  # spelled in the function itself, by steps or between blocks
        self.size = len(self._slots)
        self._once = {arg for arg, n in times.items() if n == 1 and isinstance(arg, str)}.difference(own, stored)

    @property
    def workspace(self) -> int:
        return self.size + self.below

    def array(self, name: str, count: int, on_stack: int | None = None) -> list[str]:
        """Declare an array, before any block: on the C stack if it is short, else in the workspace."""
        if count <= (ON_STACK if on_stack is None else on_stack):
            return [f"double {name}[{count}];"]
        self.size += count
        return [f"double *const {name} = w + {self.size - count};"]

    def scope(self) -> Scope:
        """Returns the names as they are spelled in the function itself, between its blocks."""
        elsewhere = {arg: self._load(arg) for arg in self._uses[0] if arg in self._home}
        return Scope(
            self.names,
            self.size,
            elsewhere,
            count=self.count,
            slots=self._slots,
            declared=self._between,
            lanes=self._spelling.lanes,
            truth=self._spelling.truth,
        )

    def signature(self, *pointers: str) -> str:
        """Returns the name and the C parameters of the function."""
        values = [] if self.indirect else [f"{kind(arg)} {self.names[arg]}" for arg in self.captured]
        values += [f"double *{pointer}" for pointer in (*pointers, *["w"] * (self.workspace > 0))]
        return f"@({', '.join(values + ['teg_context *ctx'] * self.context) or 'void'})"

    def opening(self) -> list[str]:
        """Returns the lines that read captured values from the workspace where the function needs them, or write them to it for
        its parts."""
        if self.indirect:
            return self._declarations(arg for arg in self.captured if arg in self._uses[0])
        return packed(f"w[{self._slots[arg]}] = {self.names[arg]};" for arg in self.captured if arg in self._slots)

    def block(self, index: int) -> list[str]:
        """Returns the lines that run a block at the present values of the variables."""
        lines: list[str] = []
        if kept := [arg for arg in self.variables if arg in self._slots]:
            used = {arg for step in self.blocks[index] for arg in (*step.uses, *step.stored)}
            lines += [f"w[{self._slots[arg]}] = {self.variables[arg]};" for arg in kept if arg in used]
        for number, part in self._cuts[index]:
            lines += self._call(number, part) if number else self._lines(part, self.scope())
        return lines

    def _call(self, number: int, part: list[Step]) -> list[str]:
        """Print a part; the line that calls it."""
        loads = self._declarations(arg for arg in self._uses[number] if self._home.get(arg, 0) != number)
        inside = indent(
            *loads, *self._lines(part, Scope(self.names, self.size, count=self.count, slots=self._slots, truth=self._spelling.truth))
        )
        used = {local for step in part for local in step.locals}
        if loads or any(name in self._slots for step in part for name in step.defines):
            used.add(WORKSPACE)
        passed = [local for local in LOCALS if local in used]
        head = ", ".join(local.type + local.name for local in passed)
        self.parts.append(wrapped([f"static void @_part_{number}({head or 'void'})", "{", *inside, "}"]))
        return [f"@_part_{number}({', '.join(local.name for local in passed)});"]

    def _lines(self, steps: list[Step], scope: Scope) -> list[str]:
        """Returns the lines of steps; a value used once waits until the step that uses it."""
        used = {arg for step in steps for arg in step.uses}
        here = used | self._own
        lines: list[str] = []
        for step in steps:
            scope.declared = step.uses
            waiting = [arg for arg in step.uses if arg in scope.waiting]
            for arg in waiting:
                if len(scope.waiting[arg].text) > step.longest:
                    lines.append(_declared(arg, scope.waiting.pop(arg), scope))
            if step.lines is not None:
                lines += step.lines(scope)
            elif step.assign is not None:
                text = _value(step.assign, step.uses, scope)
                while len(text.text) > INLINE and len(step.uses) < 4:
                    longest = max(step.uses, key=lambda arg: len(scope.waiting[arg].text) if arg in scope.waiting else 0)
                    if longest not in scope.waiting:
                        break
                    lines.append(_declared(longest, scope.waiting.pop(longest), scope))
                    text = _value(step.assign, step.uses, scope)
                name = step.assign.name
                if name in used and name in self._once and step.assign.op != "tie" and len(text.text) <= INLINE:
                    scope.waiting[name] = text
                elif name in here or name not in self._slots:
                    lines.append(_declared(name, text, scope))
                else:
                    scope.name(name)
                    lines.append(f"w[{self._slots[name]}] = {text.text};")
            for arg in waiting:
                scope.waiting.pop(arg, None)
            kept = [name for name in step.defines if name in self._slots and (step.assign is None or name in here)]
            if kept:
                lines += packed(f"w[{self._slots[name]}] = {self.names[name]};" for name in kept)
        return lines

    def _declarations(self, args: Iterable[Arg]) -> list[str]:
        """Returns the lines that read values from the workspace."""
        by_kind: dict[str, list[str]] = {"double": [], "int": []}
        for arg in args:
            self.names[arg] = self.names[arg].replace("[", "_").replace("]", "")  # not in an array any more
            by_kind[kind(arg)].append(f"{self.names[arg]} = {self._load(arg)}")
        return [line for c, parts in by_kind.items() for line in packed(parts, f"const {c} ", ", ", ";")]

    def _load(self, arg: Arg) -> str:
        slot = f"w[{self._slots[arg]}]"
        return f"({slot} != 0.0)" if kind(arg) == "int" else slot


@dataclass(frozen=True, slots=True)
class Routine:
    """A C function that needs `workspace` doubles at `w`; if `indirect`, captured values come first there; some want a `context`."""

    name: str
    indirect: bool
    workspace: int
    context: bool


def captured_by(own: Sequence[Arg], steps: list[Step], variables: Iterable[str]) -> list[Arg]:
    """Returns the names that a routine takes from outside, in order of first use, and the literals that are not simple."""
    defined = {name for step in steps for name in step.defines}.union(variables)
    uses = dict.fromkeys((*own, *(arg for step in steps for arg in (*step.uses, *step.stored))))
    names = [arg for arg in uses if isinstance(arg, str) and arg not in defined]
    numbers = [float(arg) for arg in uses if not isinstance(arg, (str, bool))]
    literals = [x for x in numbers if abs(x) < float("inf") and not (abs(x) <= 64 and (4 * x).is_integer())]
    return [*names, *(literals if len(literals) <= LITERALS else ())]


def assignments(stmt: Assign) -> Iterator[Step]:
    """Yields the lines of an assignment; a sum or product of very many operands is a chain."""
    args, name = stmt.args, stmt.name
    if stmt.op in NEUTRAL:
        for link in range(1, -(-(len(args) - 1) // (ARITY - 1))):
            yield _assignment(Assign(f"{name}+{link}", stmt.op, args[:ARITY]))
            args = (f"{name}+{link}", *args[ARITY:])
        stmt = Assign(name, stmt.op, args) if args is not stmt.args else stmt
    yield _assignment(stmt)


def _assignment(stmt: Assign) -> Step:
    match stmt.op:
        case "powi":
            uses = stmt.args[:1] * (2 if stmt.args[1] == 2 else 1)
        case "tie":
            uses = stmt.args[:3]
        case "call":
            uses = stmt.args[1:]
        case "lower" | "upper":
            uses = stmt.args * 2
        case _:
            uses = stmt.args
    return Step((stmt.name,), uses, stmt, weight=1 + len(uses) // 8, locals=(CONTEXT,) if stmt.op == "tie" else ())


def _value(stmt: Assign, uses: Sequence[Arg], scope: Scope) -> Text:
    rest = stmt.args[1:] if stmt.op == "powi" else stmt.args[:1] if stmt.op == "call" else ()
    return expression(stmt.op, [scope.spell(arg) for arg in uses], rest)


def _declared(name: Arg, value: Text, scope: Scope) -> str:
    assert isinstance(name, str)
    return f"const {scope.kind(name)} {scope.name(name)} = {value.text};"


def _cut(blocks: list[list[Step]], whole: Container[int]) -> list[list[tuple[int, list[Step]]]]:
    """Returns each block as numbered parts of bounded weight; a block that stays whole has number 0."""
    long = sum(step.weight for block in blocks for step in block) > PART
    cuts: list[list[tuple[int, list[Step]]]] = []
    number = 0
    for index, block in enumerate(blocks):
        if not long or index in whole or sum(step.weight for step in block) <= PART:
            cuts.append([(0, block)])
            continue
        cut: list[tuple[int, list[Step]]] = []
        room = 0
        for step in block:
            if step.weight > room:
                number += 1
                cut.append((number, []))
                room = PART
            cut[-1][1].append(step)
            room -= step.weight
        cuts.append(cut)
    return cuts
