"""Results of kernels in the structure of an expression, and in the shapes of a call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

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
    """Returns Σ slope · direction, over the entries of parameters of these dimensions, in the structure of a value."""
    import numpy as np

    if isinstance(value, tuple):
        return tuple(along_direction(v, [(slope[i], d, dimensions) for slope, d, dimensions in terms]) for i, v in enumerate(value))
    products = [np.multiply(slope, d).sum(axis=tuple(range(-dimensions, 0))) if dimensions else slope * d for slope, d, dimensions in terms]
    return plain(sum(products[1:], start=products[0])) if products else 0.0


def weighted(slope: Any, weight: Any, dimensions: int) -> Any:
    """Returns a derivative times a cotangent of the shape of the batch."""
    import numpy as np

    return slope * np.asarray(weight).reshape(np.shape(weight) + (1,) * dimensions) if dimensions else plain(slope * weight)


def stacked(columns: Sequence[Any], rows: tuple[int, ...], behind: tuple[int, ...]) -> Any:
    """Returns products with unit directions as a block of the Hessian, of shape rows + behind (behind a batch)."""
    import numpy as np

    if columns and isinstance(columns[0], tuple):
        return tuple(stacked([c[i] for c in columns], rows, behind) for i in range(len(columns[0])))
    if not behind:
        return columns[0]
    block = np.stack(columns, axis=-1) if columns else np.zeros((*rows, 0))
    return block.reshape(*block.shape[:-1], *behind)
