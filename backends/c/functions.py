"""The functions that a kernel calls, each a translation unit of its own: what surrounds them is compiled once for all bodies.

    kernel     extern double (*const teg_function_3)(double, double);            declarations(program, called)
    function   double teg_5e0c…_0(double p0, double p1) { … }                    units(program, called): a function and its derivatives
    binding    double (*const teg_function_3)(double, double) = teg_5e0c…_0;     binding(program, called), compiled when all is linked

A unit is named by what it is, so a function that is known to the cache is not compiled again, whatever calls it. What is called at the same
inputs, a function and its derivatives, is one C function: `teg_function_3_4` writes both results to an array.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import cast

from teg.backends.c.bodies import merged
from teg.backends.c.printer import Together, function_name
from teg.backends.c.runtime import runtime
from teg.backends.c.unit import function_texts, print_kernel
from teg.program import TEXTS, Program, Unbound

MACROS = """\
#ifdef __GNUC__
#define TEG_HIDDEN __attribute__((visibility("hidden")))
#define TEG_PURE __attribute__((const))
#else
#define TEG_HIDDEN
#define TEG_PURE
#endif"""


def kernel_text(program: Program, counted: bool, real: str) -> tuple[str, tuple[Together, ...]]:
    """Returns the text of a program without its functions, and which of these it calls together; printed once for all bodies."""
    return (_kept_text if program.functions else _text)(Unbound(program), counted, real)


def _text(unbound: Unbound, counted: bool, real: str) -> tuple[str, tuple[Together, ...]]:
    program, called = unbound.program, list[Together]()
    text = print_kernel(program, counted=counted, real=real, declare=partial(_declarations, program, called))
    return text, tuple(called)


_kept_text = lru_cache(maxsize=TEXTS)(_text)


def _declarations(program: Program, known: list[Together], called: Sequence[Together]) -> list[str]:
    """Returns the declarations of the functions that a kernel calls: they depend on their arguments only. `known` receives their names."""
    known += called
    rows = [f"extern TEG_HIDDEN {_pointer(program, ks)}{' TEG_PURE' if len(ks) == 1 else ''};" for ks in called]
    return [MACROS, "\n".join(rows)] if rows else []


def function_units(program: Program, called: Sequence[Together]) -> tuple[list[str], str]:
    """Returns the texts of the functions, one for each with its derivatives, and the text that says which body each name stands for."""
    together: dict[object, list[Together]] = {}
    for ks in called:
        together.setdefault(program.functions[ks[0]].callee, []).append(ks)
    units: dict[str, None] = {}
    rows: dict[str, None] = {}
    for calls in together.values():
        bodies = [merged([cast(Program, program.functions[k].body) for k in ks]) for ks in calls]
        plain = ["\n\n".join(function_texts(body, "teg")) for body in bodies]
        name = "teg_" + hashlib.sha256("\0".join(plain).encode()).hexdigest()[:20]
        texts = [text for i, body in enumerate(bodies) for text in function_texts(body, f"{name}_{i}")]
        units["\n\n".join([*runtime(texts), *texts]) + "\n"] = None
        for i, ks in enumerate(calls):
            rows[f"extern TEG_HIDDEN {_signature(program, ks, f'{name}_{i}')};"] = None
            rows[f"extern TEG_HIDDEN {_pointer(program, ks)};"] = None
            rows[f"{_pointer(program, ks)} = {name}_{i};"] = None
    return list(units), "\n\n".join([MACROS, "\n".join(rows)]) + "\n"


def _pointer(program: Program, called: Together) -> str:
    return _signature(program, called, f"(*const {function_name(called)})")


def _signature(program: Program, called: Together, name: str) -> str:
    inputs = ["double"] * len(program.functions[called[0]].derivative)
    if len(called) == 1:
        return f"double {name}({', '.join(inputs) or 'void'})"
    return f"void {name}({', '.join([*inputs, 'double *'])})"
