"""The bodies of functions as flat programs, and programs with these in their places.

A program with an application is lowered without its body (`teg.function`). The two are joined here: a body is differentiated and lowered
once for all applications, and a program is bound to other bodies without being visited.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import cast

from teg.analysis.bodies import body_of, write_all_out
from teg.analysis.settings import Integration
from teg.ir.expr import Expr, Param
from teg.ir.function import Function, Slot
from teg.ir.traverse import substitute
from teg.passes.lower.integrals import schedule
from teg.program import Assign, Called, Program


def with_bodies(program: Program, functions: Sequence[Function] = ()) -> Program:
    """Returns the program with the bodies of its functions, those of slots being `functions`; the other parts are shared with it."""
    if not program.functions:
        return program
    bound = []
    for f in program.functions:
        callee = functions[f.callee.number] if isinstance(f.callee, Slot) and functions else f.callee
        bound.append(Called(callee, f.derivative, body_program(callee, f.derivative)) if isinstance(callee, Function) else f)
    return replace(program, functions=tuple(bound))


@lru_cache(maxsize=256)
def body_program(function: Function, derivative: tuple[int, ...]) -> Program:
    """Returns the flat program of a derivative of a function: one parameter for each input, one output."""
    variables, body = body_of(function, derivative)
    names = [str(i) for i in range(len(variables))]
    inputs = [Param.make(name, ()) for name in names]
    closed = cast(Expr, substitute(write_all_out(body), dict(zip(variables, inputs, strict=True))))
    program = schedule([closed], names, Integration(), ())
    value = program.outputs[0]
    if not isinstance(value, str):  # a number
        program = replace(program, body=(*program.body, Assign("v0", "const", (value,))), outputs=("v0",))
    return program
