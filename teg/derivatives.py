"""`teg.diff`, `teg.grad`, `teg.jvp`, `teg.hessian`, `teg.eliminate`: of scalar programs, and of those with arrays and sums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from teg import pipeline
from teg.errors import ArrayIndexError, ParameterError
from teg.ir import expr as ex
from teg.ir.arrays import Array, arrays_of, has_arrays, integer_parameters
from teg.ir.cells import check_indices
from teg.ir.expr import ONE, Expr, Param, Tuple, as_number
from teg.ir.traverse import parameters
from teg.passes.differentiate import through_sums as arrays
from teg.passes.differentiate.through_sums import Parameter, outlined, parameters_and_arrays
from teg.passes.normalise.sums import NeedsLengths

Maps = pipeline.Maps


def diff(e: object, by: Param, maps: Maps = ()) -> Expr:
    """Returns the derivative of e by a parameter, deltas visible. A δ in e is eliminated first. A tuple is differentiated entry by entry.

    By a whole array: `teg.grad`.
    """
    if isinstance(by, Array):
        raise ParameterError(
            f"{by.name} is an array: its derivative is one, too", None, f"teg.grad(e, [{by.name}])[0], or teg.jvp along one"
        )
    return pipeline.diff(e, by, maps) if not _with_arrays(e) else jvp(e, {by: ONE}, maps)


def jvp(e: object, direction: Mapping[Any, object], maps: Maps = ()) -> Expr:
    """Returns the directional derivative Σ ∂e/∂p · direction[p] (forward mode), deltas visible. The direction of an array is an array."""
    if not _with_arrays(e):
        return pipeline.jvp(e, direction, maps)
    parameters_and_arrays(list(direction))
    return _by_entry(e, lambda entry: arrays.tangent(entry, direction, lambda cell, along: pipeline.jvp(cell, along, maps)))


def grad(e: object, by: Sequence[Parameter] | Parameter | None = None, maps: Maps = ()) -> Tuple:
    """Returns the derivatives of e by each parameter (reverse mode; default: all), a tuple, deltas visible. For a tuple e: a tuple of
    these.

    The derivative by an array is an expression whose value is an array of its shape: sums of numbers times `1[V; i, …]`, the array that
    is 1 at one place.
    """
    if not _with_arrays(e):
        return pipeline.grad(e, by, maps)  # type: ignore[arg-type]
    wrt = _every(e) if by is None else parameters_and_arrays(by)

    def derive(cell: Expr, symbols: Sequence[Param]) -> list[Expr]:
        return list(pipeline.grad(cell, symbols, maps).children)

    found = _by_entry(e, lambda entry: ex.tuple_of(*arrays.gradient(entry, wrt, derive)))
    assert isinstance(found, Tuple)
    return found


def hessian(e: object, by: Sequence[Param] | Param | None = None, maps: Maps = ()) -> Tuple:
    """Returns the matrix of second derivatives of e, a tuple of tuples, with the deltas of the second differentiation visible."""
    if _with_arrays(e):
        raise ParameterError(
            "the Hessian of a program with arrays is not written out",
            None,
            "its product with a direction is: f.hvp(values, direction) of the compiled program; f.hessian(values) gives numbers",
        )
    return pipeline.hessian(e, by, maps)


def eliminate(e: object, maps: Maps = ()) -> Expr:
    """Returns e without δ: each is reduced to one variable and sifted, with the user's maps if they help."""
    if not _with_arrays(e):
        return pipeline.eliminate(e, maps)
    return _by_entry(e, lambda entry: arrays.on_cells(entry, partial(pipeline.normal_form, maps=maps)))


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
        raise ArrayIndexError("a sum inside an integral must be written out, and its length is not known yet", request.node, hint) from None
    return _on_entries(plain, step)


def _on_entries(e: Expr, step: Any) -> Expr:
    if isinstance(e, Tuple):
        return ex.tuple_of(*(_on_entries(entry, step) for entry in e.children))
    result = step(e)
    assert isinstance(result, Expr)
    return result
