"""The bodies of functions as flat programs, and programs with these in their places.

What stands around an application is scheduled without its body (`teg.function`). Here the two meet: a body is differentiated and scheduled
once, whatever applies it, and a program is bound to other bodies without being looked at.
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
    """The program with the bodies of its functions, those of slots being `functions`; the rest is shared with it."""
    if not program.functions:
        return program
    bound = []
    for f in program.functions:
        callee = functions[f.callee.number] if isinstance(f.callee, Slot) and functions else f.callee
        bound.append(Called(callee, f.derivative, body_program(callee, f.derivative)) if isinstance(callee, Function) else f)
    linked = replace(program, functions=tuple(bound))
    object.__setattr__(linked, "printed", program.printed)  # its text is the same, whatever the functions are
    return linked


@lru_cache(maxsize=256)
def body_program(function: Function, derivative: tuple[int, ...]) -> Program:
    """The flat program of a derivative of a function: a parameter an input, one output."""
    variables, body = body_of(function, derivative)
    names = [str(i) for i in range(len(variables))]
    inputs = [Param.make(name, ()) for name in names]
    closed = cast(Expr, substitute(write_all_out(body), dict(zip(variables, inputs, strict=True))))
    program = schedule([closed], names, Integration(), ())
    value = program.outputs[0]
    if not isinstance(value, str):  # a number
        program = replace(program, body=(*program.body, Assign("v0", "const", (value,))), outputs=("v0",))
    return program
