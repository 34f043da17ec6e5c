"""Checks of whole programs and of lists of parameters."""

from __future__ import annotations

from collections.abc import Iterable

from teg.errors import NameClashError, ParameterError, ScopeError
from teg.ir.expr import Expr, Param
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.ir.traverse import parameters


def check_program(e: Expr) -> None:
    """Checks that a program is closed and gives each name to one thing. Raises ScopeError or NameClashError."""
    if e.free:
        names = ", ".join(sorted(v.name for v in e.free))
        one = next(iter(e.free))
        raise ScopeError(
            f"a variable stands outside its integral: {names}",
            e,
            f"integrate over it, teg.integral(e, ({one.name}, 0, 1)), or make it a parameter: teg.param({one.name!r})",
        )
    bound = {n.var.name for n in postorder([e]) if isinstance(n, Integral)}
    for p in parameters(e):
        if p.name in bound:
            raise NameClashError(
                f"{p.name!r} is a parameter and a variable of integration in one program",
                e,
                "rename one of them",
            )


def check_parameters(wrt: object) -> list[Param]:
    """Returns a user's list of parameters, one or several, each once. Raises ParameterError."""
    if isinstance(wrt, Param):
        return [wrt]
    if isinstance(wrt, Expr) or not isinstance(wrt, Iterable):
        raise ParameterError("derivatives are taken by parameters", wrt, 'make one with t = teg.param("t")')
    if isinstance(wrt, str):
        raise ParameterError(f"derivatives are taken by parameters, not by the text {wrt!r:.80}", None, f"[teg.param({wrt!r:.80})]")
    chosen: dict[Param, None] = {}
    for p in wrt:
        if not isinstance(p, Param):
            made = f"teg.param({p!r:.80})" if isinstance(p, str) else 't = teg.param("t")'
            raise ParameterError("derivatives are taken by parameters", p, f"make one with {made}")
        if p in chosen:
            raise ParameterError(f"the parameter {p.name!r} is listed twice")
        chosen[p] = None
    return list(chosen)
