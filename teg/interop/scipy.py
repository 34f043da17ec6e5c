"""`teg.scipy_function`: a program as functions of one vector, the form that `scipy.optimize` takes. It needs NumPy only."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

from teg.errors import OptionError, ParameterError
from teg.evaluator.arguments import refuse_masked
from teg.evaluator.compile import compile
from teg.evaluator.options import checked_dtype
from teg.ir.arrays import Array
from teg.ir.expr import Operand, Param
from teg.report.explanation import SHOWN, shortened

if TYPE_CHECKING:
    import numpy as np

Parameter = Param | Array


def scipy_function(
    e: Operand,
    parameters: Sequence[Parameter] | Parameter,
    *,
    fixed: Mapping[Any, Any] | None = None,
    shapes: Mapping[Any, int | Sequence[int]] | None = None,
    **options: Any,
) -> VectorFunction:
    """Returns the functions (fun, jac) of one vector x, which holds the values of `parameters` in their order.

        fun, jac = teg.scipy_function((e - 0.25) ** 2, [t], fixed={"a": 2.0})
        scipy.optimize.minimize(fun, [0.5], jac=jac).x.round(3).tolist()  # [1.0]

    fun(x) is a float, jac(x) the gradient, float64 of x's shape (n,). For a tuple of m expressions they are a vector (m,) and the
    Jacobian matrix (m, n), the form that `scipy.optimize.least_squares` takes. `hessp(x, p)`, an attribute of the result, is the Hessian
    times p.

    An array parameter takes as many places as it has entries, row by row; `shapes` gives its shape: `shapes={"V": (10, 2)}`. `fixed`
    gives the values of all other parameters, by parameter or name. Options are those of `teg.compile`. `pack` makes a vector of a dict
    of values, `unpack` the dict of a vector.

    The results of one call are kept for the next call at the same x. Raises ParameterError for a vector of another length or with
    entries that are not finite, and if values are missing, unknown or given twice. Values of e that are not finite are returned; a line
    search steps back from them.
    """
    moving = [parameters] if isinstance(parameters, Param | Array) else list(parameters)
    if not moving:
        raise ParameterError("there is nothing to move: no parameter is named", None, "teg.scipy_function(e, [t, a])")
    if (dtype := checked_dtype(options.get("dtype", "float64"))) != "float64":
        raise OptionError(f"dtype={dtype!r} is not for scipy.optimize, which compares nearly equal results", None, "float64")
    return VectorFunction(compile(e, moving, **options), moving, _by_name(fixed), _by_name(shapes))


class VectorFunction:
    """Functions of the vector of some parameters of an evaluator; unpacks to (fun, jac). Safe to share between threads, and pickles.

        functions = teg.scipy_function(e, [t, a])
        functions.size                            # 2

    Each method raises ParameterError for a vector of another length, or with entries that are not finite, and the errors of a call.
    """

    def __init__(
        self, evaluator: Any, moving: Sequence[Parameter], fixed: Mapping[str, Any], shapes: Mapping[str, int | Sequence[int]]
    ) -> None:
        self.evaluator = evaluator
        self.fixed = dict(fixed)
        self._moving, self._given_shapes = tuple(moving), dict(shapes)
        names = [p.name for p in moving]
        self.shapes = {p.name: _shape_of(p, shapes) for p in moving}
        if unknown := [k for k in shapes if not isinstance(next((p for p in moving if p.name == k), None), Array)]:
            raise ParameterError(f"shapes= names {unknown[0]!r}, which is no array that moves", None, "parameters: " + ", ".join(names))
        if twice := [k for k in self.fixed if k in self.shapes]:
            raise ParameterError(f"{twice[0]!r} cannot be fixed and move", None, "leave it out of fixed=, or of the parameters")
        if unknown := [k for k in self.fixed if k not in evaluator.parameters]:
            raise ParameterError(f"fixed= names {unknown[0]!r}, which is no parameter", None, ", ".join(evaluator.parameters))
        if missing := [k for k in evaluator.parameters if k not in self.shapes and k not in self.fixed]:
            raise ParameterError(f"no value for {', '.join(map(repr, missing))}", None, f"fixed={{{missing[0]!r}: …}}, or let it move")
        self.size = sum(math.prod(shape) for shape in self.shapes.values())
        self._last: tuple[bytes, Any, np.ndarray | None] | None = None
        self._wants_gradients = False

    def __iter__(self) -> Iterator[Callable[[Any], Any]]:
        return iter((self.fun, self.jac))

    def fun(self, x: Any) -> Any:
        """Returns the value at x, a float; of a tuple of m expressions an array (m,).

        functions.fun([0.5, 2.0])             # 0.0625
        """
        return self._at(x, self._wants_gradients)[0]

    def jac(self, x: Any) -> np.ndarray:
        """Returns the gradient at x, an array (n,); of a tuple of m expressions (m, n).

        functions.jac([0.5, 2.0]).tolist()    # [0.25, -0.03125]
        """
        self._wants_gradients = True  # from now on `fun` computes both at once
        return cast("np.ndarray", self._at(x, True)[1]).copy()

    def hessp(self, x: Any, p: Any) -> np.ndarray:
        """Returns the Hessian at x times p, an array (n,). Raises OptionError for a tuple of expressions.

        functions.hessp([0.5, 2.0], [1.0, 0.0]).tolist()  # [0.5, -0.125]
        """
        import numpy as np

        if isinstance(self._at(x, False)[0], np.ndarray):
            raise OptionError("each expression of a tuple has a Hessian of its own", None, "hessp is for one expression")
        along = self.evaluator.hvp(self._values(self._checked(x)), self.unpack(p))
        return np.concatenate([np.ravel(along[name]) for name in self.shapes])

    def pack(self, values: Mapping[Any, Any]) -> np.ndarray:
        """Returns the vector (n,) of values of the moving parameters, given by parameter or name.

        functions.pack({"t": 0.5, "a": 2.0}).tolist()  # [0.5, 2.0]
        """
        import numpy as np

        by_name = _by_name(values)
        if missing := [name for name in self.shapes if name not in by_name]:
            raise ParameterError(f"no value for {', '.join(map(repr, missing))}", None, "the vector holds " + ", ".join(self.shapes))
        for name, shape in self.shapes.items():
            refuse_masked(name, by_name[name])
            if np.shape(by_name[name]) != shape:
                raise ParameterError(f"{name!r} has the shape {shape}, not {np.shape(by_name[name])}")
        return np.concatenate([np.ravel(np.asarray(by_name[name], dtype=np.float64)) for name in self.shapes])

    def unpack(self, x: Any) -> dict[str, Any]:
        """Returns the values of the moving parameters, floats and arrays, by name.

        functions.unpack([0.5, 2.0])          # {'t': 0.5, 'a': 2.0}
        """
        vector = self._checked(x)
        parts: dict[str, Any] = {}
        first = 0
        for name, shape in self.shapes.items():
            size = math.prod(shape)
            part = vector[first : first + size]
            parts[name] = part.reshape(shape) if shape or size != 1 else float(part[0])
            first += size
        return parts

    def __repr__(self) -> str:
        places = ", ".join(name + "".join(f"[{n}]" for n in shape) for name, shape in self.shapes.items())
        return f"<teg.scipy_function of the vector ({places}), for {shortened(str(self.evaluator.expression), SHOWN)}>"

    def __reduce__(self) -> tuple[object, ...]:
        return (VectorFunction, (self.evaluator, self._moving, self.fixed, self._given_shapes))

    def _values(self, vector: np.ndarray) -> dict[str, Any]:
        return {**self.fixed, **self.unpack(vector)}

    def _at(self, x: Any, gradient: bool) -> tuple[Any, np.ndarray | None]:
        """Returns the value at x, and its gradient if it is wanted or was computed last time."""
        import numpy as np

        vector = self._checked(x)
        key, last = vector.tobytes(), self._last
        if last is not None and last[0] == key and (last[2] is not None or not gradient):
            return last[1], last[2]
        values = self._values(vector)
        slopes: np.ndarray | None = None
        if gradient:
            result, by_name = self.evaluator.value_and_grad(values)
            value = _flat(result)
            columns = [np.reshape(_flat(by_name[name]), (np.size(value), -1)) for name in self.shapes]
            slopes = np.concatenate(columns, axis=1)
            slopes = slopes if isinstance(value, np.ndarray) else slopes[0]
        else:
            value = _flat(self.evaluator(values))
        self._last = key, value, slopes
        return value, slopes

    def _checked(self, x: Any) -> np.ndarray:
        import numpy as np

        refuse_masked("x", x)
        try:
            array = np.asarray(x)
            if array.dtype.kind not in "fiub":
                raise TypeError
            vector = np.asarray(array, dtype=np.float64)
        except (TypeError, ValueError):
            raise ParameterError(f"this is no vector of real numbers: {x!r:.80}") from None
        if vector.shape != (self.size,) and not (self.size == 1 and vector.shape == ()):
            sizes = ", ".join(f"{k} ({math.prod(s)})" if s else k for k, s in self.shapes.items())
            raise ParameterError(f"a vector of shape ({self.size},) is needed, not {vector.shape}", None, f"it holds {sizes}")
        if not np.isfinite(vector).all():
            place = int(np.argmin(np.isfinite(np.ravel(vector))))
            raise ParameterError(f"entry {place} of the vector is {np.ravel(vector)[place]}, not a finite number")
        return vector.reshape(self.size)


def _by_name(values: Mapping[Any, Any] | None) -> dict[str, Any]:
    return {(k if isinstance(k, str) else getattr(k, "name", str(k))): v for k, v in (values or {}).items()}


def _shape_of(p: Parameter, shapes: Mapping[str, int | Sequence[int]]) -> tuple[int, ...]:
    if not isinstance(p, Array):
        return ()
    if p.name not in shapes:
        raise ParameterError(f"the shape of the array {p.name!r} is not known", None, f"shapes={{{p.name!r}: (…)}}")
    stated = shapes[p.name]
    shape = (stated,) if isinstance(stated, int) else tuple(stated)
    if len(shape) != p.dimensions or not all(isinstance(n, int) and n >= 0 for n in shape):
        raise ParameterError(f"{stated!r} is no shape of an array of {p.dimensions} dimensions", p.name)
    return shape


def _flat(values: Any) -> Any:
    """Returns a value as a float, or the values of a tuple, nested or not, as one array."""
    import numpy as np

    if not isinstance(values, tuple):
        return float(values) if np.ndim(values) == 0 else values
    leaves: list[Any] = []
    stack = [values]
    while stack:
        top = stack.pop()
        if isinstance(top, tuple):
            stack.extend(reversed(top))
        else:
            leaves.append(top)
    return np.array(leaves)
