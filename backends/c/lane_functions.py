"""C functions of eight points side by side: which of them are on the straight line, and what it gives (`lanes`)."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Iterator, Sequence
from dataclasses import replace

from teg.backends.c.frame import Frame, Scope, Spelling, Step, assignments, captured_by
from teg.backends.c.lanes import SIDE, Packed, nodes_across
from teg.backends.c.text import TRUTH, UNARY, indent, literal, operand
from teg.backends.c.text import packed as in_few_lines
from teg.numerics.quadrature import gauss_legendre
from teg.program import Arg, Assign, Polygon, Stmt, assigned
from teg.program.names import is_parameter, parameter_numbers

SELECTIONS = {"select", "lower", "upper", "min", "max"}
"""Operations whose operands have names in loops over eight points: gcc makes no selection of what is computed in a branch."""
BRANCHLESS = {"and": "all", "or": "any", "exp": "teg_exp", "expm1": "teg_expm1"}
"""Operations that loops over eight points replace: without branches, and without calls."""


def used_inputs(found: Packed) -> tuple[list[int], list[int]]:
    """Returns the parameters, by their numbers, that the decision uses, and those that the straight line does."""
    return _inputs((*found.settling, *found.deciding), (found.live, found.fast)), _inputs(found.straight, found.outputs)


def _inputs(steps: Sequence[Stmt], outputs: Iterable[Arg]) -> list[int]:
    used = {a for stmt in steps for a in _given(stmt)}.union(outputs)
    return parameter_numbers(used)


def _given(stmt: Stmt) -> set[Arg]:
    """Returns the names that a statement of the straight line uses."""
    if isinstance(stmt, Assign):
        return set(stmt.args)
    assert isinstance(stmt, Polygon)
    inside = {a for s in (*stmt.setup, *stmt.body) if isinstance(s, Assign) for a in s.args}
    own = {name for s in (*stmt.setup, *stmt.body) for name in assigned(s)}.union(stmt.variables)
    return ({stmt.width, stmt.height, *stmt.values, *stmt.factors} | inside) - own


def signature(inputs: Sequence[int], varying: Container[int], *more: str) -> str:
    """Returns the C parameters of a function of eight points: for an input that varies where its eight values are."""
    return ", ".join([*(f"const double *q{i}" if i in varying else f"double p{i}" for i in inputs), *more])


def _framed(
    blocks: list[list[Step]], own: Sequence[Arg], variables: Iterable[str] = (), lanes: Collection[Arg] = (), truth: str = "int"
) -> Frame:
    """Returns a C function of these blocks in which parameter i is called p{i}."""
    names = {name: name for name in captured_by(own, [step for block in blocks for step in block], ()) if isinstance(name, str)}
    known = {**{n: n for n in names if is_parameter(n)}, **{v: v for v in variables}}
    return Frame([], blocks, own, False, known, Spelling(whole=range(len(blocks)), lanes=lanes, truth=truth))


def decision(found: Packed, varying: Container[int], apart: bool = False) -> list[str]:
    """Returns the inside of the C function that tells of eight points which are `live` and which `fast`; it returns 0 if none is live, else
    1, plus 2 if one is fast. If half-planes are told `apart`, those that hold on a point's box are the bits of `held`."""

    def loop(array: str, arg: Arg, needed: Sequence[Assign], writing: str, more: Sequence[tuple[Arg, str]] = ()) -> list[str]:
        return [
            *_each_point(needed, [arg, *(a for a, _ in more)], [writing, *(text for _, text in more)], varying),
            f"for (int k = 0; k < {SIDE}; k++) some |= {array}[k];",
        ]

    held = [(least, f"held[k] {'|' if h else ''}= {{}} > 0.0 ? {1 << h} : 0;") for h, least in enumerate(found.planes if apart else ())]
    lines = ["int64_t some = 0;", *loop("live", found.live, found.settling, "live[k] = {};"), "if (!some) return 0;", "some = 0;"]
    lines += loop("fast", found.fast, found.deciding, "fast[k] = live[k] & {};", held)
    return [*lines, "return 1 | (int)some << 1;"]


def _each_point(needed: Sequence[Stmt], wanted: Sequence[Arg], writing: Sequence[str], varying: Container[int]) -> list[str]:
    """Returns a loop over eight points, numbered k, that computes the wanted values and writes them, each in the place of {}."""
    steps = _steps(replace(s, op=BRANCHLESS.get(s.op, s.op)) for s in needed if isinstance(s, Assign))
    for step in steps:
        if step.assign is not None and step.assign.op in SELECTIONS:
            step.longest = 0  # all operands are computed
    frame = _framed([steps], wanted, truth=TRUTH)
    there = [f"const double p{i} = q{i}[k];" for i in _inputs(needed, wanted) if i in varying]
    block, scope = frame.block(0), frame.scope()
    written = [text.format(scope(arg)) for text, arg in zip(writing, wanted, strict=True)]
    return [f"for ({TRUTH} k = 0; k < {SIDE}; k++) {{", *indent(*in_few_lines(there), *block, *written), "}"]


def _is_shared_choice(stmt: Assign, moving: Container[Arg]) -> bool:
    """Returns whether a choice is the same one at all points: gcc vectorises no loop with such a condition."""
    return stmt.op == "select" and stmt.args[0] not in moving


def straight(found: Packed, varying: Container[int], apart: int) -> list[str]:
    """Returns the inside of the C function of the outputs at eight points: output j of point k goes to f[apart * j + k]."""
    if found.wide:
        moving = values_in_lanes(found.straight, {f"p{i}" for i in _inputs(found.straight, found.outputs) if i in varying})
        simple = [s for s in found.straight if isinstance(s, Assign)]
        steps = [replace(s, op="teg_pick") if _is_shared_choice(s, moving) else s for s in simple]
        return _each_point(steps, found.outputs, [f"f[{apart * j} + k] = {{}};" for j in range(len(found.outputs))], varying)
    blocks: list[list[Step]] = [[]]
    own: list[Arg] = list(found.outputs)
    boxes: list[Polygon] = []
    for stmt in found.straight:
        if isinstance(stmt, Assign):
            blocks[-1] += [_choice(stmt)] if stmt.op == "choose" else assignments(stmt)
            continue
        assert isinstance(stmt, Polygon)
        blocks[-1] += _steps(stmt.setup)
        blocks += [_steps(stmt.body), [_totals(stmt)]]
        boxes.append(stmt)
        own += [stmt.width, stmt.height, *stmt.values]
    inputs = _inputs(found.straight, found.outputs)
    lanes = values_in_lanes(found.straight, {f"p{i}" for i in inputs if i in varying})
    frame = _framed(blocks, own, [v for box in boxes for v in box.variables], lanes)
    lines = [f"const teg_lanes_8 p{i} = *(const teg_lanes_8 *)(q{i} + k);" for i in inputs if i in varying]
    lines += frame.block(0)
    for number, box in enumerate(boxes):
        lines += _over_a_box(box, frame, 2 * number + 1, lanes)
        lines += frame.block(2 * number + 2)
    scope = frame.scope()
    lines += [f"*(teg_lanes_8 *)(f + {apart * j} + k) = {scope(o)} + zero;" for j, o in enumerate(found.outputs)]
    return [
        "const teg_lanes_8 zero = {0.0};",
        f"for (int k = 0; k < {SIDE}; k += (int)(sizeof(teg_lanes_8) / sizeof(double))) {{",
        *indent(*lines),
        "}",
    ]


def _steps(block: Iterable[Stmt]) -> list[Step]:
    return [step for s in block if isinstance(s, Assign) for step in assignments(s)]


def values_in_lanes(straight: Sequence[Stmt], inputs: set[str]) -> set[Arg]:
    """Returns the values that differ between points side by side, if these inputs do. What `choose` gives counts as one."""
    lanes: set[Arg] = set(inputs)

    def through(block: Iterable[Stmt]) -> None:
        for s in block:
            if isinstance(s, Assign) and s.op == "choose":
                lanes.add(s.name)
            elif isinstance(s, Assign):
                for step in assignments(s):
                    lanes.update(step.defines if lanes.intersection(step.uses) else ())

    for stmt in straight:
        through([stmt])
        if isinstance(stmt, Polygon):
            sides = (stmt.width, stmt.height)
            through(stmt.setup)
            lanes.update(v for v, side in zip(stmt.variables, sides, strict=True) if side in lanes)
            through(stmt.body)
            terms = zip(stmt.results, stmt.values, stmt.factors, strict=True)
            lanes.update(result for result, value, factor in terms if lanes.intersection((*sides, value, factor)))
    return lanes


def _type_of(args: Sequence[Arg], lanes: Collection[Arg]) -> str:
    """Returns the C type of a result of these values."""
    return "teg_lanes_8" if any(arg in lanes for arg in args) else "double"


def _choice(stmt: Assign) -> Step:
    """Returns the second of three values where the first is positive, else the third."""

    def lines(scope: Scope) -> list[str]:
        of = [scope(a) for a in stmt.args]
        name = scope.name(stmt.name)
        given = [f"const teg_lanes_8 {letter}_{name} = {text} + zero;" for letter, text in zip("gxy", of, strict=True)]
        return [*given, f"teg_lanes_8 {name};", f"teg_choose_8(&{name}, &g_{name}, &x_{name}, &y_{name});"]

    return Step((stmt.name,), stmt.args, lines=lines, weight=4)


def _over_a_box(stmt: Polygon, frame: Frame, block: int, lanes: Collection[Arg]) -> Iterator[str]:
    """Yields the lines of a product rule: what it adds up is called sum_{variable}_0, …"""
    scope, n, own = frame.scope(), nodes_across(stmt), stmt.variables[0]
    nodes, weights = gauss_legendre(n)
    places = [(0.5 + 0.5 * u, 0.5 * a) for u, a in zip(nodes, weights, strict=True)]
    texts = [f"{{{', '.join(map(literal, (u, v, a * b)))}}}," for u, a in places for v, b in places]
    yield f"static const double rule_{own}[{n * n}][3] = {{"
    yield from indent(*in_few_lines(texts))
    yield "};"
    width, height = scope(stmt.width), scope(stmt.height)
    x, y = stmt.variables
    area = _type_of([stmt.width, stmt.height], lanes)
    yield f"const {area} area_{own} = {width} * {height};"
    inside = [f"const {scope.kind(x)} {x} = {width} * rule_{own}[i][0];", f"const {scope.kind(y)} {y} = {height} * rule_{own}[i][1];"]
    inside += [f"(void){x}, (void){y};", *frame.block(block)]
    inside.append(f"const {area} weight_{own} = area_{own} * rule_{own}[i][2];")
    for j, value in enumerate(dict.fromkeys(stmt.values)):
        yield f"{_type_of([stmt.width, stmt.height, value], lanes)} sum_{own}_{j} = {{0.0}};"
        inside.append(f"sum_{own}_{j} += weight_{own} * {scope(value)};")
    yield f"for (int i = 0; i < {n * n}; i++) {{"
    yield from indent(*inside)
    yield "}"


def _totals(stmt: Polygon) -> Step:
    """Returns the results from what was added up."""
    distinct = list(dict.fromkeys(stmt.values))

    def lines(scope: Scope) -> list[str]:
        made = []
        for result, value, factor in zip(stmt.results, stmt.values, stmt.factors, strict=True):
            times = "" if factor == 1.0 else f"{operand(scope.spell(factor), UNARY)} * "
            made.append(f"const {scope.kind(result)} {scope.name(result)} = {times}sum_{stmt.variables[0]}_{distinct.index(value)};")
        return made

    return Step(stmt.results, stmt.factors, lines=lines, weight=len(stmt.results))
