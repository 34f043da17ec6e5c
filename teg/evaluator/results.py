"""Results of kernels in the structure of an expression, and in the shapes of a call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from teg.errors import ParameterError
from teg.evaluator.arguments import as_floats
from teg.ir.expr import Expr, Tuple

if TYPE_CHECKING:
    import numpy as np


def plain(value: Any) -> Any:
    """Returns a number as Python's float if NumPy gives it as a float64; single precision and arrays as they are."""
    return float(value) if isinstance(value, float) else value


def in_shape(row: np.ndarray, shape: tuple[int, ...]) -> Any:
    """Returns a result in the shape of the batch, or of its only element."""
    return row.reshape(shape + row.shape[1:]) if shape else plain(row[0])


def in_structure(e: Expr, entries: Iterator[Any]) -> Any:
    """Returns entries in the structure of a tuple expression."""
    return tuple(in_structure(entry, entries) for entry in e.children) if isinstance(e, Tuple) else next(entries)


def nested(e: Expr, rows: Iterator[Any], shape: tuple[int, ...]) -> Any:
    """Returns results in the structure of a tuple expression."""
    return tuple(nested(entry, rows, shape) for entry in e.children) if isinstance(e, Tuple) else in_shape(next(rows), shape)


def places(e: Expr, name: str) -> list[str]:
    """Returns the name of each entry of a tuple expression, nested ones in order."""
    if not isinstance(e, Tuple):
        return [name]
    return [place for i, entry in enumerate(e.children) for place in places(entry, f"{name}[{i}]")]


def along_direction(value: Any, terms: Sequence[tuple[Any, Any, int]]) -> Any:
    """Returns Σ slope · direction, over the entries of parameters of these dimensions, in the structure of a value. Raises ParameterError
    for directions whose shape does not fit."""
    if isinstance(value, tuple):
        return tuple(along_direction(v, [(slope[i], d, dimensions) for slope, d, dimensions in terms]) for i, v in enumerate(value))
    products = [_product(slope, d, "direction") for slope, d, _ in terms]
    sums = [p.sum(axis=tuple(range(-dimensions, 0))) if dimensions else p for p, (_, _, dimensions) in zip(products, terms, strict=True)]
    return plain(sum(sums[1:], start=sums[0])) if sums else 0.0


def weighted(slope: Any, weight: Any, dimensions: int) -> Any:
    """Returns Σ derivative · cotangent, of `cotangents_of`, for a parameter of these dimensions. Raises ParameterError for cotangents whose
    shape does not fit."""
    import numpy as np

    if isinstance(slope, tuple):
        return sum(weighted(s, w, dimensions) for s, w in zip(slope, weight, strict=True))
    return plain(_product(slope, np.reshape(weight, np.shape(weight) + (1,) * dimensions) if dimensions else weight, "cotangent"))


def cotangents_of(value: Any, cotangent: Any, dtype: str) -> Any:
    """Returns cotangents in the structure of a value: one for each entry of a tuple, or the same for all. Raises ParameterError for another
    number of them, and for others than numbers and arrays."""
    if not isinstance(value, tuple):
        return as_floats("the cotangent", cotangent, dtype)[()]
    every = cotangent if isinstance(cotangent, tuple | list) else (cotangent,) * len(value)
    if len(every) != len(value):
        raise ParameterError(f"{len(every)} cotangents for a tuple of {len(value)} entries", None, "give one for each entry")
    return tuple(cotangents_of(v, c, dtype) for v, c in zip(value, every, strict=True))


def _product(slope: Any, factor: Any, what: str) -> Any:
    try:
        return slope * factor
    except ValueError:
        from numpy import shape

        text = f"a {what} of shape {shape(factor)} does not fit a derivative of shape {shape(slope)}"
        raise ParameterError(text, None, f"a {what} is a number, or an array that broadcasts with the batch and the parameter") from None


def stacked(columns: Sequence[Any], rows: tuple[int, ...], behind: tuple[int, ...]) -> Any:
    """Returns products with unit directions as a block of the Hessian, of shape rows + behind (behind a batch)."""
    import numpy as np

    if columns and isinstance(columns[0], tuple):
        return tuple(stacked([c[i] for c in columns], rows, behind) for i in range(len(columns[0])))
    if not behind:
        return columns[0]
    block = np.stack(columns, axis=-1) if columns else np.zeros((*rows, 0))
    return block.reshape(*block.shape[:-1], *behind)
