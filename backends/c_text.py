"""Operations, literals and lines of C.

Expressions are printed with as few parentheses as C's precedence (and a compiler's warnings) allow, and never reorder:
`a + b + c` is (a + b) + c in the program and in C.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from math import isinf, isnan

from teg.program import Arg

WIDTH = 116  # characters in a line
CONDITIONAL, COMPARISON, SUM, PRODUCT, UNARY, ATOM = range(6)

Text = tuple[str, int]  # an expression and how tightly it binds

NEUTRAL = {"add": "0.0", "mul": "1.0", "and": "1", "or": "0"}
INFIX = {  # the sign, how the whole binds, how its first operand and the others must
    "add": (" + ", SUM, SUM, PRODUCT),
    "sub": (" - ", SUM, SUM, PRODUCT),
    "mul": (" * ", PRODUCT, PRODUCT, UNARY),
    "div": (" / ", PRODUCT, PRODUCT, UNARY),
    "and": (" && ", CONDITIONAL, COMPARISON, COMPARISON),
    "or": (" || ", CONDITIONAL, COMPARISON, COMPARISON),
}
COMPARE = {"gt0": ">", "ge0": ">=", "lt0": "<", "le0": "<="}
RENAMED = {"abs": "fabs", "mod": "teg_mod"}


def expression(op: str, args: Sequence[Text], rest: Sequence[Arg]) -> Text:
    """An operation in C; `rest` is a power's exponent, or a tie's number."""
    if op in INFIX:
        if len(args) < 2:
            return args[0] if args else (NEUTRAL[op], ATOM)
        sign, level, first, others = INFIX[op]
        return sign.join([operand(args[0], first), *[operand(arg, others) for arg in args[1:]]]), level
    match op:
        case "const":
            return args[0]
        case "neg":
            return "-" + operand(args[0], ATOM), UNARY
        case "not":
            return "!" + operand(args[0], ATOM), UNARY
        case "ok":
            return f"!isnan({args[0][0]})", UNARY
        case "gt0" | "ge0" | "lt0" | "le0":
            return f"{operand(args[0], SUM)} {COMPARE[op]} 0.0", COMPARISON
        case "select":
            b, x, y = (operand(arg, COMPARISON) for arg in args)
            return f"{b} ? {x} : {y}", CONDITIONAL
        case "powi" if rest[0] == 2:
            return f"{operand(args[0], UNARY)} * {operand(args[1], UNARY)}", PRODUCT
        case "powi":
            return f"teg_powi({args[0][0]}, {rest[0]})", ATOM
        case "tie":
            return f"teg_tie(ctx, {', '.join([text for text, _ in args])})", ATOM
    return f"{RENAMED.get(op, op)}({', '.join([text for text, _ in args])})", ATOM


def operand(arg: Text, least: int) -> str:
    """An expression where it must bind at least so tightly."""
    return arg[0] if arg[1] >= least else f"({arg[0]})"


def literal(x: float) -> str:
    """A C constant of exactly this value, safe as an operand."""
    if isnan(x):
        return "NAN"
    text = "INFINITY" if isinf(x) else repr(abs(x))
    return text if str(x)[0] != "-" else f"(-{text})"


def kind(arg: Arg) -> str:
    """The C type of a name."""
    return "int" if isinstance(arg, str) and arg[0] == "b" else "double"


def each(count: int, line: str) -> str:
    """A line for every j below `count`."""
    return line.replace("[j]", "[0]") if count == 1 else f"for (int j = 0; j < {count}; j++) {line}"


def indent(*lines: str) -> list[str]:
    return [line if line.startswith("#") else "    " + line for line in lines]


def packed(parts: Iterable[str], before: str = "", between: str = " ", after: str = "") -> list[str]:
    """As few lines as hold the parts, each line with the same beginning and end."""
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
    """The lines, long ones broken at spaces."""
    return "\n".join([line if len(line) <= WIDTH else _broken(line) for line in lines])


def _broken(line: str) -> str:
    within = line[: len(line) - len(line.lstrip())] + "    "
    return "\n".join(textwrap.wrap(line, WIDTH, subsequent_indent=within, break_long_words=False, break_on_hyphens=False))
