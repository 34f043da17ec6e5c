"""What a call gives to an evaluator with arrays: numbers as columns of a batch, arrays with their shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from teg.errors import ArrayIndexError, ParameterError
from teg.evaluator.arguments import refuse_masked
from teg.evaluator.array_plan import Compiled
from teg.ir.index import ArrayName, IndexArray
from teg.program.arrays import ArrayProgram

if TYPE_CHECKING:
    import numpy as np


EXACT = 2.0**53
"""Integer parameters come as floats, which hold whole numbers up to this one."""


class Call(NamedTuple):
    """What a call is given: a batch of n, of `shape`; columns (n,) or (), arrays with an axis n in front where the batch does not share
    them, `shapes` without it; and what has been compiled for these shapes."""

    columns: list[np.ndarray]
    arrays: list[np.ndarray]
    n: int
    shape: tuple[int, ...]
    made: Compiled
    integers: dict[int, np.ndarray]
    shapes: list[tuple[int, ...]]

    def check(self, program: ArrayProgram) -> None:
        """Raise ArrayIndexError where a program would read outside of an array."""
        from teg.backends.plan import check_ranges

        check_ranges(program, self.integers, self.arrays, self.shapes)


def as_entries(a: ArrayName, value: Any, dtype: str) -> np.ndarray:
    """An array as it was given: float64, rounded to a dtype, or 64-bit integers."""
    import numpy as np

    refuse_masked(a.name, value)
    try:
        found = np.asarray(value)
    except (TypeError, ValueError):
        raise ParameterError(f"the value of {a.name!r} is not an array of numbers: {value!r:.80}") from None
    if found.ndim < a.dimensions:
        raise ParameterError(f"{a.name!r} has {a.dimensions} dimensions, and an array of shape {found.shape} was given")
    if isinstance(a, IndexArray):
        if found.dtype.kind not in "iu":
            if found.size:
                raise ArrayIndexError(f"the entries of {a.name!r} are indices, and {found.dtype} was given", None, "use .astype(int)")
            found = found.astype(np.int64)
        if found.dtype.kind == "u" and found.size and found.max() > np.iinfo(np.int64).max:
            raise ArrayIndexError(f"an entry of {a.name!r} is too large for an index: {found.max()}")
        return np.ascontiguousarray(found, dtype=np.int64)
    if found.dtype.kind not in "fiub":
        raise ParameterError(f"the value of {a.name!r} is not an array of real numbers: {found.dtype}")
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(np.asarray(found, dtype=dtype), dtype=np.float64)


def whole_numbers(name: str, column: np.ndarray) -> np.ndarray:
    """The integers that an integer parameter holds."""
    import numpy as np

    if not np.all(np.isfinite(column)) or np.any(column != np.floor(column)):
        wrong = column[~(np.isfinite(column) & (column == np.floor(column)))] if column.ndim else column
        raise ArrayIndexError(f"{name!r} is used as an integer, and its value is {float(np.ravel(wrong)[0])!r}")
    if np.any(np.abs(column) > EXACT):
        raise ArrayIndexError(
            f"{name!r} is used as an integer, and {float(column[np.abs(column) > EXACT].flat[0]):.17g} is not held exactly"
        )
    return np.asarray(column, dtype=np.int64)
