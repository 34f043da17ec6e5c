"""Operations, literals and lines of C.

Expressions are printed with as few parentheses as C's precedence (and a compiler's warnings) allow, and never reorder:
`a + b + c` is (a + b) + c in the program and in C.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from math import isinf, isnan
from typing import NamedTuple

from teg.program import Arg
from teg.program.names import is_condition

WIDTH = 116  # characters in a line
TRUTH = "int64_t"
"""The type of conditions in loops over points, as wide as numbers: compilers make vectors of as many of them."""
HARMLESS = "_ .,=+-/[]()"
CONDITIONAL, COMPARISON, SUM, PRODUCT, UNARY, ATOM = range(6)


class Text(NamedTuple):
    """An expression, how tightly it binds, and for -x what x is."""

    text: str
    level: int
    negated: Text | None = None


NEUTRAL = {"add": "0.0", "mul": "1.0", "and": "1", "or": "0", "all": "1", "any": "0"}
INFIX = {  # the sign, how the whole binds, how its first operand and the others must
    "add": (" + ", SUM, SUM, PRODUCT),
    "sub": (" - ", SUM, SUM, PRODUCT),
    "mul": (" * ", PRODUCT, PRODUCT, UNARY),
    "div": (" / ", PRODUCT, PRODUCT, UNARY),
    "and": (" && ", CONDITIONAL, COMPARISON, COMPARISON),
    "or": (" || ", CONDITIONAL, COMPARISON, COMPARISON),
    "all": (" & ", CONDITIONAL, ATOM, ATOM),  # and, or without branches: all operands are computed
    "any": (" | ", CONDITIONAL, ATOM, ATOM),
}
COMPARE = {"gt0": ">", "ge0": ">=", "lt0": "<", "le0": "<="}
RENAMED = {"abs": "fabs", "mod": "teg_mod", "powi": "teg_powi", "tie": "teg_tie", "fma": "teg_fma", "min": "teg_min", "max": "teg_max"}


LONG_SUM = 16
"""Terms of a sum that is written as that of two halves: fewer of its additions wait for another one."""


def expression(op: str, args: Sequence[Text], rest: Sequence[Arg]) -> Text:
    """Returns an operation in C; `rest` is a power's exponent, or the number of the function that is called."""
    if op in INFIX:
        if len(args) < 2:
            return args[0] if args else Text(NEUTRAL[op], ATOM)
        if op == "add" and len(args) >= LONG_SUM:
            middle = (len(args) + 1) // 2
            args = [expression(op, half, rest) for half in (args[:middle], args[middle:])]
        sign, level, first, others = INFIX[op]
        parts = [operand(args[0], first)]
        for arg in args[1:]:
            less = arg.negated if op == "add" else None
            parts.append(sign + operand(arg, others) if less is None else " - " + operand(less, others))
        return Text("".join(parts), level)
    match op:
        case "const":
            return args[0]
        case "neg":
            return Text("-" + operand(args[0], ATOM), UNARY, args[0])
        case "not":
            return Text("!" + operand(args[0], ATOM), UNARY)
        case "ok":
            return Text(f"!isnan({args[0].text})", UNARY)
        case "gt0" | "ge0" | "lt0" | "le0":
            return Text(f"{operand(args[0], SUM)} {COMPARE[op]} 0.0", COMPARISON)
        case "select":
            b, x, y = (operand(arg, COMPARISON) for arg in args)
            return Text(f"{b} ? {x} : {y}", CONDITIONAL)
        case "lower" | "upper":
            x, y = (operand(arg, SUM) for arg in args[:2])
            return Text(f"{x} {'<' if op == 'lower' else '>'} {y} ? {x} : {y}", CONDITIONAL)
        case "call":
            return Text(f"teg_function_{rest[0]}({', '.join(arg.text for arg in args)})", ATOM)
        case "powi" if rest[0] == 2:
            return Text(f"{operand(args[0], UNARY)} * {operand(args[1], UNARY)}", PRODUCT)
    given = [*(["ctx"] if op == "tie" else []), *(arg.text for arg in args), *map(str, rest)]
    return Text(f"{RENAMED.get(op, op)}({', '.join(given)})", ATOM)


def operand(arg: Text, least: int) -> str:
    """Returns an expression where it must bind at least so tightly."""
    return arg.text if arg.level >= least else f"({arg.text})"


def literal(x: float) -> str:
    """Returns a C constant of exactly this value, safe as an operand."""
    if isnan(x):
        return "NAN"
    text = "INFINITY" if isinf(x) else repr(abs(x))
    return text if str(x)[0] != "-" else f"(-{text})"


def kind(arg: Arg) -> str:
    """Returns the C type of a name."""
    return "int" if is_condition(arg) else "double"


def harmless(name: str, most: int = 60) -> str:
    """Returns a user's name as it may stand in a comment: ASCII letters, digits and HARMLESS; `<U+03BB>` for all others; long
    ones are cut."""
    shown = ""
    for c in name:
        part = c if c.isascii() and (c.isalnum() or c in HARMLESS) else f"<U+{ord(c):04X}>"
        if len(shown) + len(part) > most:
            return shown + "..."
        shown += part
    return shown


def identifiers(text: str) -> set[str]:
    """Returns the words in a text of C: names, keywords, and numbers without their signs and points."""
    return set(text.translate(_APART).split())


_APART = {code: " " for code in range(128) if not (chr(code).isalnum() or chr(code) == "_")}


def each(count: int, line: str) -> str:
    """Returns a line for every j below `count`."""
    return line.replace("[j]", "[0]") if count == 1 else f"for (int j = 0; j < {count}; j++) {line}"


def indent(*lines: str) -> list[str]:
    return [line if line.startswith("#") else "    " + line for line in lines]


def packed(parts: Iterable[str], before: str = "", between: str = " ", after: str = "") -> list[str]:
    """Returns the parts on as few lines as possible, each line with the same beginning and end."""
    lines: list[list[str]] = []
    room = 0
    for part in parts:
        if len(part) > room:
            lines.append([])
            room = WIDTH - 24 - len(before)
        lines[-1].append(part)
        room -= len(part) + len(between)
    return [before + between.join(line) + after for line in lines]


def wrapped(lines: Iterable[str]) -> str:
    """Returns the lines, long ones broken at spaces."""
    return "\n".join([line if len(line) <= WIDTH else _broken(line) for line in lines])


def _broken(line: str) -> str:
    within = line[: len(line) - len(line.lstrip())] + "    "
    return "\n".join(textwrap.wrap(line, WIDTH, subsequent_indent=within, break_long_words=False, break_on_hyphens=False))


def spelled(arg: str | int | float) -> str:
    """Returns a name, or a literal."""
    if isinstance(arg, str):
        return arg
    if isinstance(arg, float):
        return literal(arg)
    return f"INT64_C({arg})" if arg >= 0 else f"(-INT64_C({-arg}))"
