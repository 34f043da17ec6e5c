"""`teg.diff`, `teg.grad`, `teg.jvp`, `teg.hessian`, `teg.eliminate`: of scalar programs, and of those with arrays and sums.

`teg.stop_delta` marks a part of a program whose jumps do not move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, TypeVar, overload

from teg import pipeline
from teg.analysis.bodies import write_all_out
from teg.errors import ArrayIndexError, OptionError, ParameterError
from teg.ir import simplify
from teg.ir.arrays import Array, arrays_of, has_arrays, integer_parameters
from teg.ir.cells import check_indices
from teg.ir.expr import ONE, Cond, Expr, Operand, Param, Tuple, Var
from teg.ir.operands import as_number
from teg.ir.still import with_still_conditions
from teg.ir.traverse import parameters
from teg.maps.diffeomorphism import checked_maps
from teg.passes.differentiate import through_sums as arrays
from teg.passes.differentiate.through_sums import Parameter, on_cells, outlined, parameters_and_arrays
from teg.passes.normalise.cuts import with_cuts
from teg.passes.normalise.sums import NeedsLengths

Maps = pipeline.Maps
N = TypeVar("N", Tuple, Cond, Expr)


@overload
def diff(e: Tuple, by: Param | Var, maps: Maps = ()) -> Tuple: ...
@overload
def diff(e: Operand, by: Param | Var, maps: Maps = ()) -> Expr: ...
def diff(e: Operand, by: Param | Var, maps: Maps = ()) -> Expr:
    """Returns the derivative of e by a parameter, deltas visible. A δ in e is eliminated first. A tuple is differentiated entry by entry.

    `by` may be a variable that is free in e, which is then a part of an integrand: velocities, gradients of a field. The jumps of e give
    deltas, so that ∫ₐᵇ ∂e/∂x dx is e(b) - e(a). By a whole array: `teg.grad`.

        area = teg.integral(teg.bracket(x + y < t), (x, 0, 1), (y, 0, 1))
        str(teg.diff(area, t))                           # ∫[y: 0..1] (∫[x: 0..1] δ(t - (x + y)))
        teg.evaluate(teg.diff(area, t), {t: 0.5})        # 0.5
        str(teg.diff(teg.bracket(x < t), x))             # -δ(t - x)

    Raises ParameterError for another `by`, ScopeError for a variable that e integrates over, NotDifferentiableError, DeltaError and
    NoReparameterisationError for derivatives that the language does not have.
    """
    if isinstance(by, Array):
        raise ParameterError(
            f"{by.name} is an array: its derivative is one, too", None, f"teg.grad(e, [{by.name}])[0], or teg.jvp along one"
        )
    if not isinstance(by, Param | Var):
        hint = f"make one with teg.param({by!r:.80})" if isinstance(by, str) else 'make one with t = teg.param("t")'
        raise ParameterError("a derivative is taken by one parameter or variable; several: teg.grad(e, [t, a])", by, hint)
    return jvp(e, {by: ONE}, maps)


@overload
def jvp(e: Tuple, direction: Mapping[Any, Any], maps: Maps = ()) -> Tuple: ...
@overload
def jvp(e: Operand, direction: Mapping[Any, Any], maps: Maps = ()) -> Expr: ...
def jvp(e: Operand, direction: Mapping[Any, Any], maps: Maps = ()) -> Expr:
    """Returns the directional derivative Σ ∂e/∂p · direction[p] (forward mode), deltas visible.

    p is a parameter, a variable that is free in e, or an array, whose direction is an array.

        teg.evaluate(teg.jvp(t * t * a, {t: 1, a: 2}), {t: 3.0, a: 5.0})  # 48.0

    Raises ParameterError for a direction along anything but parameters and variables.
    """
    maps = _checked(maps)
    if not _with_arrays(e):
        return pipeline.jvp(e, direction, maps)
    variables = [p for p in direction if isinstance(p, Var)]
    parameters_and_arrays([p for p in direction if not isinstance(p, Var)])
    whole = pipeline.apart_from(e if isinstance(e, Tuple) else as_number(e), variables)
    return _by_entry(whole, lambda entry: arrays.tangent(entry, direction, lambda cell, along: pipeline.jvp(cell, along, maps)))


def grad(e: Operand, by: Sequence[Parameter | Var] | Parameter | Var | None = None, maps: Maps = ()) -> Tuple:
    """Returns the derivatives of e by each parameter (reverse mode; default: all), a tuple, deltas visible. For a tuple e: a tuple of
    these.

        slopes = teg.grad(teg.integral(teg.bracket(x < t) * a, (x, 0, 1)), [t, a])
        [float(teg.evaluate(s, {t: 0.25, a: 2.0})) for s in slopes]  # [2.0, 0.25]

    The derivative by an array is an expression whose value is an array of its shape: sums of numbers times `1[V; i, …]`, the array that
    is 1 at one place. Variables that are free in e may be among `by` (forward mode then), as in `teg.diff`. Raises as
    `teg.diff`, and ParameterError for a parameter that is listed twice.
    """
    maps, listed = _checked(maps), [by] if isinstance(by, Var) else by
    if isinstance(listed, list | tuple) and any(isinstance(p, Var) for p in listed):
        return _by_each(e if isinstance(e, Tuple) else as_number(e), list(listed), maps)
    chosen: Any = listed
    if not _with_arrays(e):
        return pipeline.grad(e, chosen, maps)
    wrt = _every(e) if chosen is None else parameters_and_arrays(chosen)

    def derive(cell: Expr, symbols: Sequence[Param]) -> list[Expr]:
        return list(pipeline.grad(cell, symbols, maps).children)

    found = _by_entry(e, lambda entry: simplify.tuple_of(*arrays.gradient(entry, wrt, derive)))
    assert isinstance(found, Tuple)
    return found


def _by_each(e: Expr, by: Sequence[Parameter | Var], maps: Maps) -> Tuple:
    if isinstance(e, Tuple):
        return simplify.tuple_of(*(_by_each(entry, by, maps) for entry in e.children))
    return simplify.tuple_of(*(diff(e, p, maps) for p in by))  # type: ignore[arg-type]


@overload
def stop_delta(e: N) -> N: ...
@overload
def stop_delta(e: Operand) -> Expr: ...
def stop_delta(e: Operand | Cond) -> Expr | Cond:
    """Returns e with jumps that do not move: its value is that of e, its derivatives are those with all brackets constant.

    Conditions (of `teg.bracket`, `where`, `abs`, `minimum`, `nearest` and so on), steps (`floor`, `mod`), cuts of functions (`atan2`,
    `atan(1/u)`) and deltas in e read their parameters, but are not differentiated by them. So no delta comes out of this part of a
    program, in derivatives of any order and in every backend, while other parts keep theirs. Bounds of integrals move as before.
    `discontinuities="ignore"` does the same to a whole program. Functions (`teg.function`) in e are written out; a condition is
    accepted, too.

        edge, shade = teg.bracket(x < t), teg.where(x < t, t, 2.0)
        f = teg.compile(teg.integral(teg.stop_delta(shade), (x, 0, 1)), [t])
        f.value_and_grad(t=0.25)                         # (1.5625, {'t': 0.25})

    With the edge the derivative is 0.25 - 1.75.
    """
    whole: Expr | Cond = e if isinstance(e, Tuple | Cond) else as_number(e)
    whole = write_all_out(whole)
    return with_still_conditions(whole if isinstance(whole, Cond) else on_cells(whole, with_cuts))


def hessian(e: Operand, by: Sequence[Param] | Param | None = None, maps: Maps = ()) -> Tuple:
    """Returns the matrix of second derivatives of e, a tuple of tuples, with the deltas of the second differentiation visible.

        matrix = teg.hessian(t * t * a, [t, a])
        teg.evaluate(matrix[0][1], {t: 3.0, a: 5.0})  # 6.0

    Raises ParameterError for a program with arrays, whose Hessian `f.hvp` and `f.hessian` of the compiled program give.
    """
    if _with_arrays(e):
        raise ParameterError(
            "the Hessian of a program with arrays is not written out",
            None,
            "its product with a direction is: f.hvp(values, direction) of the compiled program; f.hessian(values) gives numbers",
        )
    return pipeline.hessian(e, by, _checked(maps))


@overload
def eliminate(e: Tuple, maps: Maps = ()) -> Tuple: ...
@overload
def eliminate(e: Operand, maps: Maps = ()) -> Expr: ...
def eliminate(e: Operand, maps: Maps = ()) -> Expr:
    """Returns e without δ: each is reduced to one variable and sifted, with the user's maps if they help.

        str(teg.eliminate(teg.integral(teg.delta(x - t) * x, (x, 0, 1))))  # [t < 1 & ~(t < 0)]·t

    Raises NoReparameterisationError for a surface that no family can reduce.
    """
    maps = _checked(maps)
    if not _with_arrays(e):
        return pipeline.eliminate(e, maps)
    return _by_entry(e, lambda entry: arrays.on_cells(entry, partial(pipeline.normal_form, maps=maps)))


def _checked(maps: object) -> Maps:
    """Returns a list of maps. Raises OptionError for what is none, such as the order or the second parameter of a derivative."""
    try:
        return checked_maps(maps)
    except OptionError as problem:
        hint = "a second derivative is teg.diff(teg.diff(e, t), t), those by several parameters are teg.grad(e, [t, a])"
        raise OptionError(problem.what, None, f"{hint}; {problem.hint}") from None


def _with_arrays(e: object) -> bool:
    return has_arrays(e if isinstance(e, Tuple) else as_number(e))


def _every(e: object) -> list[Parameter]:
    assert isinstance(e, Expr)
    counted = set(integer_parameters(e))
    return [*(p for p in parameters(e) if p not in counted), *(a for a in arrays_of(e) if isinstance(a, Array))]


def _by_entry(e: object, step: Any) -> Expr:
    """Returns the result of a step on an outlined expression; on a tuple, entry by entry."""
    whole = e if isinstance(e, Tuple) else as_number(e)
    check_indices(whole)
    try:
        plain = outlined(whole)
    except NeedsLengths as request:
        hint = "give it a range of numbers, or compile the program: f.value_and_grad knows the lengths"
        raise ArrayIndexError(
            "what is inside an integral must be written out, and its length is not known yet", request.node, hint
        ) from None
    return _on_entries(plain, step)


def _on_entries(e: Expr, step: Any) -> Expr:
    if isinstance(e, Tuple):
        return simplify.tuple_of(*(_on_entries(entry, step) for entry in e.children))
    result = step(e)
    assert isinstance(result, Expr)
    return result
