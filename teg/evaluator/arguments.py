"""What a call gives to an evaluator: values by name, by position or as a dict, to columns of a batch."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from decimal import Decimal
from numbers import Real
from typing import TYPE_CHECKING, Any

from teg.errors import ParameterError
from teg.ir.expr import Param

if TYPE_CHECKING:
    import numpy as np


def batch(
    names: Sequence[str], args: tuple[Any, ...], named: Mapping[str, Any], dtype: str = "float64"
) -> tuple[list[np.ndarray], tuple[int, ...], int]:
    """A column for each parameter, of shape () or (n,), the shape of the batch, and n, its size. Raises ParameterError for values that are
    missing, unknown, given twice, no real numbers, or of shapes that do not broadcast together."""
    import numpy as np  # when it is needed: `import teg` stays fast

    given = values(names, args, named)
    arrays = [as_floats(name, given[name], dtype) for name in names]
    if all([a.ndim == 0 for a in arrays]):
        return arrays, (), 1
    try:
        shape = np.broadcast_shapes(*(a.shape for a in arrays))
    except ValueError:
        shapes = ", ".join(f"{k}: {a.shape}" for k, a in zip(names, arrays, strict=True))
        raise ParameterError(f"the shapes of the parameters do not broadcast together: {shapes}") from None
    n = math.prod(shape)
    return [a if a.ndim == 0 else np.broadcast_to(a, shape).reshape(n) for a in arrays], shape, n  # copied only where they must be


def values(names: Sequence[str], args: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
    """The value given for each of the names. Raises ParameterError where one is missing, unknown or given twice."""
    given: dict[str, Any] = {}
    if len(args) == 1 and isinstance(args[0], Mapping):
        given = {(k.name if isinstance(k, Param) else k): v for k, v in args[0].items()}
    elif len(args) > len(names):
        raise ParameterError(f"{len(args)} values for {len(names)} parameters", None, _signature(names))
    else:
        given = dict(zip(names, args, strict=False))
    for k, v in named.items():
        if k in given:
            raise ParameterError(f"the parameter {k!r} is given twice", None, _signature(names))
        given[k] = v
    if unknown := [str(k) for k in given.keys() - set(names)]:
        raise ParameterError(f"there is no parameter named {', '.join(map(repr, unknown))}", None, _signature(names))
    if missing := [k for k in names if k not in given]:
        raise ParameterError(f"no value for {', '.join(map(repr, missing))}", None, _signature(names))
    return given


def plain_numbers(names: Sequence[str], args: tuple[Any, ...], named: Mapping[str, Any]) -> Sequence[float] | None:
    """The values in the order of the names, if all are given by name or all by position, and are Python's or NumPy's floats or small whole
    numbers; else None, and `batch` says what is wrong, if anything is. It is all that a call at one point needs, and quick."""
    if args:
        found: Sequence[Any] = args
        if named or len(args) != len(names):
            return None
    else:
        if len(named) != len(names):
            return None
        try:
            found = [named[name] for name in names]
        except KeyError:
            return None
    for value in found:
        if not isinstance(value, float) and (type(value) is not int or value.bit_length() > 64):
            return None
    return found


def refuse_masked(name: str, value: Any) -> None:
    """Raise ParameterError for an array with masked entries, or a list of arrays of which one has any: NumPy reads through the mask."""
    masked = sys.modules.get("numpy.ma")
    if masked is None or isinstance(value, Real | Decimal):
        return
    stack = [value]
    while stack:
        top = stack.pop()
        if isinstance(top, masked.MaskedArray):
            if masked.is_masked(top):
                raise ParameterError(
                    f"the array given for {name!r} has masked entries, which have no value",
                    None,
                    "give the values that count: compressed(), or filled(…) with numbers of your choice",
                )
        elif isinstance(top, list | tuple):
            stack.extend(top)


def as_floats(name: str, value: Any, dtype: str = "float64") -> np.ndarray:
    """A value as an array of floats. Raises ParameterError where it is not a real number or an array of them."""
    import numpy as np

    refuse_masked(name, value)
    try:
        if isinstance(value, Real | Decimal):
            with np.errstate(over="ignore"):
                return np.asarray(float(value), dtype=dtype)
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise TypeError
        with np.errstate(over="ignore"):
            return np.asarray(array, dtype=dtype)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"the value of {name!r} is not a real number or an array of them: {value!r:.80}") from None


def _signature(names: Sequence[str]) -> str:
    return "the parameters are " + (", ".join(names) or "none")


def as_doubles(columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The columns as float64."""
    import numpy as np

    return [np.asarray(column, dtype=np.float64) for column in columns]


def rounded(results: np.ndarray) -> np.ndarray:
    """Results as float32; what is too large for it is infinite."""
    import numpy as np

    with np.errstate(over="ignore"):
        return results.astype(np.float32)


def with_rounding(results: np.ndarray) -> np.ndarray:
    """Results and then as many estimates of their errors as float32, the estimates with what rounding the results adds."""
    import numpy as np

    half = len(results) // 2
    values, errors = results[:half], results[half:]
    with np.errstate(all="ignore"):
        short = values.astype(np.float32)
        added = np.where(np.isfinite(values), np.abs(short - values), 0.0)
        return np.concatenate([short, np.nextafter((errors + added).astype(np.float32), np.float32(np.inf))])
