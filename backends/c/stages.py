"""The straight line of points that surfaces cross as C: functions of eight points.

Stages. A sum over nodes is a loop of its own, so the straight line is cut before and after the sums; each stage is a loop over the points,
which the C compiler vectorises, and values that a later stage reads lie in arrays. Values that are the same for all points are computed
by a function of their own, once for all that wait in queues: several straight lines of a program share it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from typing import NamedTuple

from teg.backends.c.contracted import contracted, decisive
from teg.backends.c.crossed import BRANCHLESS, SIDE, TOGETHER, Crossed
from teg.backends.c.frame import Frame, Scope, Spelling, Step, assignments
from teg.backends.c.items import Item, Nodes, defines, reads
from teg.backends.c.lane_functions import SELECTIONS, values_in_lanes
from teg.backends.c.ordered import ordered
from teg.backends.c.regrouped import alike, regrouped
from teg.backends.c.text import TRUTH, indent, literal
from teg.backends.c.text import packed as in_few_lines
from teg.program import Arg, Assign
from teg.program.names import is_condition, is_number, is_parameter, parameter_numbers


def inputs_of(found: Crossed) -> list[int]:
    """Returns the numbers of the parameters that are read."""
    used = {a for item in found.items for a in reads(item)}.union(found.outputs, (found.good,))
    return parameter_numbers(used)


class Inside(NamedTuple):
    """The inside of a C function, and the numbers of the inputs that it reads."""

    text: list[str]
    inputs: list[int]


class Point(NamedTuple):
    """A straight line without sums over nodes for a loop over points. `inputs` are the numbers of the inputs that vary, which are called c;
    `printed` gives its lines of C, and its outputs in C (None: 0), if the inputs with these numbers are `teg_lanes_8`. An output that is
    the product of two values is this pair."""

    inputs: list[int]
    printed: Callable[[Collection[int]], tuple[list[str], list[str | tuple[str, str] | None]]]


class Functions(NamedTuple):
    """The insides of C functions. `steady` writes what is the same at all points to an array s of `kept` numbers, inputs among it; each of
    `lines` computes eight points with it. Its inputs are those that vary, arrays q. `point` is the inside of a loop over points. If
    `steady` is for eight groups of points, `kept` is what one has, and the last `conditions` of these are read from an array m."""

    steady: Inside
    kept: int
    conditions: int
    lines: list[Inside]
    point: Point | None = None


Written = Callable[[Scope], list[str]]
"""The lines that write the outputs of point k."""
Writing = Callable[[Crossed], Written]
"""How the outputs of a straight line are written."""


def results(found: Crossed) -> Written:
    """Output j of point k goes to f[SIDE·j + k], and good[k] is 0 where they must be computed otherwise."""

    def lines(scope: Scope) -> list[str]:
        outputs = [f"f[{SIDE * j} + k] = {scope(o)};" for j, o in enumerate(found.outputs)]
        return [*outputs, f"good[k] = {scope(found.good)} ? 1.0 : 0.0;"]

    return lines


def totals(found: Crossed, sums: Sequence[int]) -> Written:
    """Of the first `count` points, output sums[m] is added to lanes[m][k] if it is right; good[k] is 0 where it is not."""

    def lines(scope: Scope) -> list[str]:
        good = f"const {TRUTH} good_k = {scope(found.good)};" if found.good is not True else ""
        known = [f"const {TRUTH} added = k < count;"] if not good else [good, f"const {TRUTH} added = (k < count) & good_k;"]
        given = [(m, found.outputs[j]) for m, j in enumerate(sums)]
        written = [f"lanes[{m}][k] += added ? {scope(o)} : 0.0;" for m, o in given if o != 0.0]
        return [*known, *written, *(["good[k] = good_k ? 1.0 : 0.0;"] if good else [])]

    return lines


def functions(
    lines: Sequence[Crossed], varying: Container[int], writing: Writing, point: Crossed | None = None, groups: Container[int] | None = None
) -> Functions:
    """Returns the functions of straight lines of one program, and the lines of a `point`, another one without sums over nodes. Inputs in
    `varying` differ between points. If what is the same at all points is computed for eight groups of them, inputs in `groups` differ
    between these."""
    found = alike([regrouped(line, varying) for line in (*lines, *([] if point is None else [point]))], varying)
    stages = [_Stages(line, varying, "q{}[k]" if n < len(lines) else "c{}") for n, line in enumerate(found)]
    constant = list({s.name: s for stage in stages for s in stage.constant}.values())
    wanted = set[Arg]().union(*(stage.moving for stage in stages))
    same = [f"p{i}" for i in parameter_numbers(wanted) if i not in varying]
    given = [*same, *(s.name for s in constant if s.name in wanted)]
    steady, places, kept = _steady(constant, given) if groups is None else _steady_of_groups(constant, given, groups)
    inputs = [[i for i in parameter_numbers(stage.moving) if i in varying] for stage in stages]
    made = [Inside(list(stages[n].lines(writing(stages[n].found), places)), inputs[n]) for n in range(len(lines))]
    inside = Inside(steady, parameter_numbers([*same, *(a for s in constant for a in s.args)]))
    return Functions(
        inside,
        kept,
        sum(map(is_condition, given)),
        made,
        Point(inputs[-1], partial(stages[-1].point, places)) if point is not None else None,
    )


def _steady(constant: Sequence[Assign], given: Sequence[str]) -> tuple[list[str], dict[str, str], int]:
    """Returns the lines that write given values to an array, where each stands there, and how many numbers that is. Conditions stand there
    once for each point: C compilers make a mask of one by a dozen operations."""
    numbers, conditions = ([name for name in given if is_condition(name) is of] for of in (False, True))
    lines, scope = _made(constant, given)
    lines += in_few_lines(f"s[{i}] = {scope(name)};" for i, name in enumerate(numbers))
    places = {name: f"s[{i}]" for i, name in enumerate(numbers)}
    for i, name in enumerate(conditions):
        at = len(numbers) + SIDE * i
        lines.append(f"for (int k = 0; k < {SIDE}; k++) s[{at} + k] = {scope(name)};")
        places[name] = f"(s[{at} + k] != 0.0)"
    return lines, places, len(numbers) + SIDE * len(conditions)


def _steady_of_groups(constant: Sequence[Assign], given: Sequence[str], groups: Container[int]) -> tuple[list[str], dict[str, str], int]:
    """Returns the lines that write given values of eight groups to an array, side by side, how each is spelled if s begins with those of a
    group, and how many there are. Conditions stand once for each point in an array m."""
    numbers, conditions = ([name for name in given if is_condition(name) is of] for of in (False, True))
    lines, scope = _made(constant, given)
    inputs = parameter_numbers([*given, *(a for s in constant for a in s.args)])
    there = [f"const double p{i} = q{i}[k];" for i in inputs if i in groups]
    written = [f"s[{SIDE * i} + k] = {scope(name)};" for i, name in enumerate(numbers)]
    written += [f"s[{SIDE * i} + k] = {scope(name)} ? 1.0 : 0.0;" for i, name in enumerate(conditions, len(numbers))]
    loop = [f"for ({TRUTH} k = 0; k < {SIDE}; k++) {{", *indent(*in_few_lines(there), *lines, *in_few_lines(written)), "}"]
    places = {name: f"s[{SIDE * i}]" for i, name in enumerate(numbers)}
    places |= {name: f"(m[{SIDE * i} + k] != 0.0)" for i, name in enumerate(conditions)}
    return loop, places, len(given)


def _made(constant: Sequence[Assign], given: Sequence[str]) -> tuple[list[str], Scope]:
    """Returns the lines that compute given values, and the scope in which they are spelled."""
    inputs = {str(a): str(a) for a in (*given, *(a for s in constant for a in s.args)) if is_parameter(a)}
    frame = _framed(_steps(_late(constant, [name for name in given if not is_parameter(name)])), given, inputs)
    return frame.block(0), frame.scope()


class _Stages:
    """The stages of a straight line in C: `places` says how a value is spelled that an earlier stage has, `inputs_as` how inputs are that
    vary."""

    def __init__(self, found: Crossed, varying: Container[int], inputs_as: str) -> None:
        self.found = found
        inputs = inputs_of(found)
        self.places: dict[str, str] = {f"p{i}": inputs_as.format(i) if i in varying else f"p{i}" for i in inputs}
        self.lanes: set[Arg] = {f"p{i}" for i in inputs if i in varying}
        self.stage: dict[Arg, int] = {}
        self.last = 0
        for item in found.items:
            number = max((self.stage.get(a, 0) for a in reads(item)), default=0) + isinstance(item, Nodes)
            self.stage.update(dict.fromkeys(defines(item), number))
            self.last = max(self.last, number)
            if isinstance(item, Nodes) or not self.lanes.isdisjoint(reads(item)):
                self.lanes.update(defines(item))
        self.constant = [i for i in found.items if isinstance(i, Assign) and i.name not in self.lanes]
        self.moving = self._read_by(self.without(self.constant))
        self.exact = decisive(found.items)
        self._arrays = count()
        self._count = [0]

    def lines(self, written: Written, steady: Mapping[str, str]) -> Iterator[str]:
        """Yields the lines of eight points; `steady` says how what is the same at all points is spelled."""
        self.places.update(steady)
        assigns = [i for i in self.found.items if isinstance(i, Assign)]
        for number in range(self.last + 1):
            here = [s for s in assigns if s.name in self.lanes and self.stage[s.name] == number]
            later = [i for i in self.without(here) if max(self.stage[d] for d in defines(i)) >= number]
            yield from self._loop(here, self._read_by(later), written if number == self.last else None)
            for item in self.found.items:
                if isinstance(item, Nodes) and self.stage[item.sums[0]] == number + 1:
                    yield from self._nodes(item)

    def point(self, steady: Mapping[str, str], side_by_side: Collection[int]) -> tuple[list[str], list[str | tuple[str, str] | None]]:
        """Returns the lines of a point, or of eight if some inputs are `side_by_side`, and the outputs, of which products that nothing else
        reads are pairs."""
        self.places.update(steady)
        outputs = self.found.outputs
        block = [s for s in self.found.items if isinstance(s, Assign) and s.name in self.lanes]
        block = contracted(block, outputs, self.exact)
        lanes = values_in_lanes(block, {f"p{i}" for i in side_by_side})
        uses = Counter([*outputs, *(a for s in block for a in s.args)])
        products = [s for s in block if s.op == "mul" and len(s.args) == 2 and s.name in lanes and s.name in outputs]
        pairs: dict[Arg, tuple[Arg, ...]] = {s.name: s.args for s in products if uses[s.name] == 1}
        block = [replace(s, op="teg_fma_8") if s.op == "fma" and s.name in lanes else s for s in block if s.name not in pairs]
        made = {s.name for s in block}
        own = [o for o in dict.fromkeys(a for o in outputs for a in pairs.get(o, (o,))) if isinstance(o, str)]
        frame = self._framed(_steps(_late(block, [o for o in own if o in made])), own, self.places, lanes)
        text, scope = frame.block(0), frame.scope()
        return text, [None if o == 0.0 else (scope(pairs[o][0]), scope(pairs[o][1])) if o in pairs else scope(o) for o in outputs]

    def without(self, some: Iterable[Item]) -> list[Item]:
        """Returns the other items."""
        left_out = set(map(id, some))
        return [i for i in self.found.items if id(i) not in left_out]

    def _read_by(self, items: Iterable[Item]) -> set[Arg]:
        return {a for i in items for a in reads(i)}.union(self.found.outputs, (self.found.good,))

    def _frame(self, block: Sequence[Assign], wanted: Collection[Arg]) -> tuple[Frame, list[str]]:
        """Returns a block in which names of earlier stages are spelled as arrays, and those of its values that are wanted."""
        given = [s.name for s in block if s.name in wanted]
        block, names = ordered(contracted(block, given, self.exact), given)
        return self._framed(_steps(block), names, self.places), given

    def _framed(self, steps: list[Step], own: Sequence[Arg], places: dict[str, str], lanes: Collection[Arg] = ()) -> Frame:
        frame = _framed(steps, own, places, lanes)
        frame.count = self._count  # names differ in all stages
        return frame

    def _written(self, block: Sequence[Assign]) -> tuple[Scope, list[str]]:
        """Returns the lines that compute a block, and the scope in which the outputs are spelled."""
        outputs = [o for o in dict.fromkeys((*self.found.outputs, self.found.good)) if isinstance(o, str)]
        names = {s.name for s in block}
        own = [o for o in outputs if o in self.places or o in names]
        block = contracted(block, own, self.exact)
        block, named = ordered(block, [o for o in own if o in names])
        frame = self._framed(_steps(block), list(dict.fromkeys((*own, *named))), self.places)
        text = frame.block(0)
        return frame.scope(), text

    def _loop(self, block: Sequence[Assign], wanted: Collection[Arg], written: Written | None) -> Iterator[str]:
        """Yields the loop of a stage; the last one writes the outputs."""
        if written is not None:
            scope, inside = self._written(block)
            inside += written(scope)
        else:
            frame, given = self._frame(block, wanted)
            inside = frame.block(0)
            scope = frame.scope()
            arrays = {name: f"a{next(self._arrays)}" for name in given}
            yield from in_few_lines([f"{array}[{SIDE}]" for array in arrays.values()], "double ", ", ", ";")
            inside += [f"{array}[k] = {scope(name)}{'' if is_number(name) else ' ? 1.0 : 0.0'};" for name, array in arrays.items()]
            self.places.update((name, f"{array}[k]" if is_number(name) else f"({array}[k] != 0.0)") for name, array in arrays.items())
        yield from self._each(inside)

    def _nodes(self, item: Nodes) -> Iterator[str]:
        """Yields the loop over nodes, some of them in each iteration."""
        number = next(self._arrays)
        total = len(item.weights)
        most = max(1, TOGETHER // max(1, len(item.body)))
        together = max(n for n in range(1, total + 1) if total % n == 0 and n <= most)
        in_array = any(isinstance(v, str) for v in item.weights)
        if in_array:
            yield f"double weight_{number}[{total}][{SIDE}];"
            given = [f"weight_{number}[{n}][k] = {self._spelled(v)};" for n, v in enumerate(item.weights)]
            yield from self._each(in_few_lines(given))
        rows = [[xs[n] for xs in item.places.values()] + ([] if in_array else [float(item.weights[n])]) for n in range(total)]
        if rows[0]:
            yield f"static const double node_{number}[{total}][{len(rows[0])}] = {{"
            yield from indent(*in_few_lines(f"{{{', '.join(map(literal, row))}}}," for row in rows))
            yield "};"
        yield f"double sum_{number}[{len(item.sums)}][{SIDE}] = {{{{0.0}}}};"
        body: list[Assign] = []
        exact = set(self.exact)
        sums: dict[Arg, list[Arg]] = {v: [] for v in item.values}
        known = dict(self.places)
        for n in range(together):
            own = {s.name: f"{s.name}_{n}" for s in item.body} | {x: f"{x}_{n}" for x in item.places}
            known |= {own[x]: f"node_{number}[i + {n}][{c}]" for c, x in enumerate(item.places)}
            weight = f"v{number}w{n}"
            known[weight] = f"weight_{number}[i + {n}][k]" if in_array else f"node_{number}[i + {n}][{len(item.places)}]"
            exact.update(own[name] for name in own if name in self.exact)
            for s in item.body:
                body.append(Assign(own[s.name], s.op, tuple(own.get(a, a) if isinstance(a, str) else a for a in s.args)))
            for j, v in enumerate(item.values):
                at = own.get(v, v) if isinstance(v, str) else v
                body.append(Assign(f"v{number}w{n}_{j}", "mul", (weight, at)))
                sums[v].append(body[-1].name)
        last: list[Arg] = []
        for j, v in enumerate(item.values):
            body.append(Assign(f"v{number}t{j}", "add", tuple(sums[v])))
            last.append(body[-1].name)
        frame = self._framed(_steps(contracted(body, last, exact)), last, known)
        inside = frame.block(0)
        scope = frame.scope()
        inside += [f"sum_{number}[{j}][k] += {scope(name)};" for j, name in enumerate(last)]
        yield f"for (int i = 0; i < {total}; i += {together}) {{"
        yield from indent(*self._each(inside))
        yield "}"
        self.places.update((name, f"sum_{number}[{j}][k]") for j, name in enumerate(item.sums))

    def _each(self, inside: Sequence[str]) -> Iterator[str]:
        """Yields a loop over the points."""
        yield f"for ({TRUTH} k = 0; k < {SIDE}; k++) {{"
        yield from indent(*inside)
        yield "}"

    def _spelled(self, arg: Arg) -> str:
        return self.places[arg] if isinstance(arg, str) else literal(float(arg))


def _framed(steps: list[Step], own: Sequence[Arg], places: dict[str, str], lanes: Collection[Arg] = ()) -> Frame:
    """Returns a block in which names of `places` are spelled so."""
    return Frame([], [steps], own, False, dict(places), Spelling(whole=(0,), lanes=lanes, truth=TRUTH))


def _late(block: Sequence[Assign], wanted: Iterable[str]) -> list[Assign]:
    """Returns the assignments of a block in an order in which each stands shortly before its first use: fewer values are alive at once."""
    made = {s.name: s for s in block}
    done: dict[str, Assign] = {}
    stack: list[tuple[str, bool]] = [(name, False) for name in reversed(list(wanted))]
    while stack:
        name, ready = stack.pop()
        if name in done:
            continue
        if ready:
            done[name] = made[name]
            continue
        stack.append((name, True))
        stack += [(a, False) for a in reversed(made[name].args) if isinstance(a, str) and a in made and a not in done]
    return list(done.values())


def _steps(block: Iterable[Assign]) -> list[Step]:
    """Returns assignments with operations that compute all of their operands: those of a selection have names."""
    steps = [step for s in block for step in assignments(replace(s, op=BRANCHLESS.get(s.op, s.op)))]
    for step in steps:
        if step.assign is not None and step.assign.op in SELECTIONS:
            step.longest = 0
    return steps
