"""The arguments of a call: values by name, by position or as a dict, read as columns of a batch and as arrays."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from decimal import Decimal
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

from teg.errors import ArrayIndexError, ParameterError
from teg.ir.creation import in_order_of_creation, is_order_certain
from teg.ir.expr import Param
from teg.ir.index import ArrayName, IndexArray
from teg.program.arrays import ArrayProgram

if TYPE_CHECKING:
    import numpy as np

EXACT = 2.0**53
"""Integer parameters come as floats, which hold integers exactly up to this one."""


class Call(NamedTuple):
    """The arguments of a call, which is a batch of `n` elements of `shape`.

    `columns` are the numbers, called `names`, each (n,), or () where the batch shares one value. `arrays` have their own shapes, `shapes`,
    with an axis n in front where the batch does not share them. `integers` are the values of the columns that hold integers, by the
    column's number.
    """

    names: list[str]
    columns: list[np.ndarray]
    arrays: list[np.ndarray]
    n: int
    shape: tuple[int, ...]
    shapes: list[tuple[int, ...]]
    integers: dict[int, np.ndarray]

    @property
    def doubles(self) -> list[np.ndarray]:
        """Returns the columns as float64."""
        import numpy as np

        return [np.asarray(column, dtype=np.float64) for column in self.columns]

    def elements(self, usable: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Returns which elements have `usable` numbers only, (n,)."""
        import numpy as np

        found = np.ones(self.n, dtype=bool)
        for column in self.columns:
            found &= usable(column)
        for array, own in zip(self.arrays, self.shapes, strict=True):
            good = usable(array)
            found &= good.all() if array.ndim == len(own) else good.reshape(self.n, math.prod(own)).all(axis=1)
        return found

    def check(self, program: ArrayProgram) -> None:
        """Raises ArrayIndexError if a program would read outside of an array."""
        from teg.backends.plan import check_ranges

        check_ranges(program, self.integers, self.arrays, self.shapes)


def read_call(
    parameters: Sequence[Param | ArrayName], given: Mapping[str, Any], integers: Collection[str] = (), dtype: str = "float64"
) -> Call:
    """Returns the call with the value `given` for each parameter, rounded to `dtype`; a number is an array of dimension 0.

    Raises ParameterError for values that are not real numbers, or of shapes that do not broadcast together; ArrayIndexError if one of
    `integers`, or an entry of an array of indices, is not an integer.
    """
    import numpy as np  # imported here, so that `import teg` stays fast

    scalars = [p.name for p in parameters if isinstance(p, Param)]
    named = [p for p in parameters if isinstance(p, ArrayName)]
    columns = [as_floats(name, given[name], "float64" if name in integers else dtype) for name in scalars]
    leading = [c.shape for c in columns]
    arrays: list[np.ndarray] = []
    shapes: list[tuple[int, ...]] = []
    for a in named:
        v = as_entries(a, given[a.name], dtype)
        arrays.append(v)
        shapes.append(v.shape[v.ndim - a.dimensions :])
        leading.append(v.shape[: v.ndim - a.dimensions])
    shape: tuple[int, ...] = ()
    n = 1
    if any(leading):
        shape = batch_shape([*scalars, *(a.name for a in named)], leading)
        n = math.prod(shape)
        columns = [c if c.ndim == 0 else (c if c.shape == shape else np.broadcast_to(c, shape)).reshape(n) for c in columns]
        arrays = [
            v if v.ndim == len(own) else np.ascontiguousarray(np.broadcast_to(v, (*shape, *own))).reshape(n, *own)
            for v, own in zip(arrays, shapes, strict=True)
        ]
    whole = {k: whole_numbers(name, columns[k]) for k, name in enumerate(scalars) if name in integers} if integers else {}
    return Call(scalars, columns, arrays, n, shape, shapes, whole)


def batch_shape(names: Sequence[str], leading: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """Returns the shape of the batch, to which the axes in front of every value's own broadcast."""
    import numpy as np

    try:
        return np.broadcast_shapes(*leading)
    except ValueError:
        text = ", ".join(f"{name}: {s}" for name, s in zip(names, leading, strict=True) if s)
        raise ParameterError(f"the shapes of the batch do not broadcast together: {text}") from None


def values_by_name(names: Sequence[str], args: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the value given for each of the names. Raises ParameterError if one is missing, unknown or given twice."""
    given: dict[str, Any] = {}
    if len(args) == 1 and isinstance(args[0], Mapping):
        given = by_name(args[0])
    elif len(args) > len(names):
        raise ParameterError(f"{len(args)} values for {len(names)} parameters", None, _signature(names))
    else:
        given = dict(zip(names, args, strict=False))
    for k, v in named.items():
        if k in given:
            raise ParameterError(f"the parameter {k!r} is given twice", None, _signature(names))
        given[k] = v
    refuse_nested(given, names)
    if unknown := [str(k) for k in given.keys() - set(names)]:
        raise ParameterError(f"there is no parameter named {', '.join(map(repr, unknown))}", None, _signature(names))
    if missing := [k for k in names if k not in given]:
        raise ParameterError(f"no value for {', '.join(map(repr, missing))}", None, _signature(names))
    return given


def by_name(values: Mapping[Any, Any]) -> dict[str, Any]:
    """Returns values by the names of their keys, parameters or names. Raises ParameterError if two keys have one name."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = name_of(key)
        if name in found:
            raise ParameterError(f"the parameter {name!r} is given twice", None, "once by itself, and once by its name")
        found[name] = value
    return found


def argument_order(every: Sequence[Param | ArrayName], wrt: Sequence[Param | ArrayName] | None) -> tuple[list[Param | ArrayName], int]:
    """Returns the arguments, those that a user lists before the others, and how many of them have a certain place."""
    listed = [] if wrt is None else list(wrt)
    others = in_order_of_creation([p for p in every if p not in set(listed)])
    return [*listed, *others], len(listed) + (len(others) if is_order_certain(others) else 0)


def refuse_uncertain(names: Sequence[str], certain: int, args: tuple[Any, ...], maker: str) -> None:
    """Raises ParameterError if more values are given by position than the `certain` first names; `maker` names the function that
    takes a list of them."""
    if certain < len(args) <= len(names):
        raise ParameterError(
            f"the order of {', '.join(names[certain:])} is not certain: they were created in several orders, so give values by name",
            None,
            f"f({', '.join(f'{name}=…' for name in names[certain:])}), or the order in a list: {maker}(e, [{', '.join(names)}])",
        )


def refuse_nested(given: Mapping[str, Any], names: Sequence[str]) -> None:
    """Raises ParameterError for a value that is itself a dict: arguments are one flat dict."""
    for k, v in given.items():
        if type(v) is not float and isinstance(v, Mapping):
            hint = f"the parameters are {', '.join(names) or 'none'}"
            if any(name_of(inner) in names for inner in v):
                hint += f"; values[{k!r}] holds some of them: take it out, {{**values, **values[{k!r}]}}"
            raise ParameterError(f"the value of {k!r} is a dict, and the arguments are one flat dict: name -> number or array", None, hint)


def plain_numbers(names: Sequence[str], args: tuple[Any, ...], named: Mapping[str, Any]) -> Sequence[float] | None:
    """Returns the values in the order of the names, if all are given by name, all by position, or all in a dict, as Python's or NumPy's
    floats or small integers.

    Else None: the general way then reads the call and reports mistakes. This is all that a call at one point needs, and fast.
    """
    if len(args) == 1 and isinstance(args[0], dict) and not named:
        return plain_numbers(names, (), by_name(args[0]))
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
    """Raises ParameterError for an array with masked entries, or a list with such an array: NumPy reads through the mask."""
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
    """Returns a value as an array of floats. Raises ParameterError if it is not a real number or an array of them."""
    import numpy as np

    if type(value) is np.ndarray and value.dtype == dtype:  # no subclass, such as a masked array
        return value
    if type(value) is float and dtype == "float64":
        return np.array(value)
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
        hint = "inside of programs of JAX teg.jax_function(e) takes it" if "Tracer" in type(value).__name__ else ""
        raise ParameterError(f"the value of {name!r} is not a real number or an array of them: {value!r:.80}", None, hint) from None


def as_entries(a: ArrayName, value: Any, dtype: str) -> np.ndarray:
    """Returns an array as it was given: float64, rounded to a dtype, or 64-bit integers."""
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
    """Returns the integers that an integer parameter holds."""
    import numpy as np

    if not np.all(np.isfinite(column)) or np.any(column != np.floor(column)):
        wrong = column[~(np.isfinite(column) & (column == np.floor(column)))] if column.ndim else column
        raise ArrayIndexError(f"{name!r} is used as an integer, and its value is {float(np.ravel(wrong)[0])!r}")
    if np.any(np.abs(column) > EXACT):
        raise ArrayIndexError(
            f"{name!r} is used as an integer, and {float(column[np.abs(column) > EXACT].flat[0]):.17g} is not held exactly"
        )
    return np.asarray(column, dtype=np.int64)


def name_of(key: Any) -> str:
    """Returns the name of a parameter or an array, or the name itself."""
    name: str = key.name if isinstance(key, Param | ArrayName) else key
    return name


def _signature(names: Sequence[str]) -> str:
    return "the parameters are " + (", ".join(names) or "none")


def rounded(results: np.ndarray) -> np.ndarray:
    """Returns results as float32; results that are too large for it are infinite."""
    import numpy as np

    with np.errstate(over="ignore"):
        return results.astype(np.float32, copy=False)


def with_rounding(values: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns results and the estimates of their errors as float32; the rounding of the results is added to the estimates."""
    import numpy as np

    with np.errstate(all="ignore"):
        short = values.astype(np.float32)
        added = np.where(np.isfinite(values), np.abs(short - values), 0.0)
        return short, np.nextafter((errors + added).astype(np.float32), np.float32(np.inf))
