"""The error classes, one for each kind of mistake, all derived from `TegError`.

The docstring of each class says what is wrong, why, and what to do about it. Its example raises the error.
"""

from __future__ import annotations


class TegError(Exception):
    """The base class of all errors that a user can cause.

    `what` says what is wrong, `where` is the expression or object at fault (None: the whole call), and `hint` says what to do about it (may
    be empty). The printed message holds all three.

    >>> teg.compile("x + 1")
    """

    def __init__(self, what: str, where: object = None, hint: str = "") -> None:
        self.what = what
        self.where = where
        self.hint = hint
        super().__init__(what)

    def __str__(self) -> str:
        lines = [self.what]
        if self.where is not None:
            text = _as_written(str(self.where))
            lines.append("  in: " + (text if len(text) <= 400 else text[:400] + " …"))
        if self.hint:
            lines.append("  hint: " + self.hint)
        return "\n".join(lines)

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.what, self.where, self.hint))


def _as_written(text: str) -> str:
    """Returns the text of an expression without the numbers by which passes keep indices of the same name apart."""
    first, *others = text.split("\0")
    return first + "".join(part.lstrip("0123456789") for part in others)


class OperandError(TegError, TypeError):
    """A value for which the language has no operation.

    Programs are built from numbers, parameters, variables and expressions; arrays of values are given when the compiled function is
    called. Way out: replace text, None or an array by an expression, and NumPy's functions by those of `teg`.

    >>> teg.sin("x")
    """


class ConditionError(TegError, TypeError):
    """A condition used as a Python truth value or as a number, or a number used as a condition.

    Whether a condition holds is not known while the program is written, so Python's `if`, `and`, `or`, `not` and `a < x < b` cannot ask
    for it. Way out: `teg.where(c, a, b)` for `if`, `& | ~` for `and`, `or`, `not`, and `teg.bracket(c)` for the number 1 or 0.

    >>> 1 if teg.var("x") < 2 else 0
    """


class ScopeError(TegError, ValueError):
    """A variable or an index outside of its integral or sum, or an integral over something that is not a variable.

    A variable has a value only inside the integral over it. Way out: integrate over the variable, or make it a parameter.

    >>> teg.compile(teg.var("x") ** 2)
    """


class BoundError(TegError, ValueError):
    """A bound of an integral that is not a number.

    A bound is a number, an expression of parameters and outer variables, or ±`math.inf`; NaN and conditions are none of these.

    >>> teg.integral(1, (teg.var("x"), 0, float("nan")))
    """


class NameClashError(TegError, ValueError):
    """One name for two different things in one program.

    Values are given by name when a program is called, so a name must be clear. Way out: rename one of the two.

    >>> x = teg.var("x")
    >>> teg.compile(teg.param("x") * teg.integral(x, (x, 0, 1)))
    """


class ParameterError(TegError, ValueError):
    """A parameter that is missing, unknown or repeated, or a value that does not fit it.

    Derivatives are taken by parameters only, not by variables of integration. Way out: give each parameter in `f.parameters` one value, a
    number or an array; the arrays of a batch have shapes that broadcast.

    >>> teg.compile(teg.param("t") ** 2)(s=1.0)
    """


class ArrayIndexError(TegError, IndexError):
    """An index that is not an integer or is out of range, a wrong number of indices, or a sum of negative length.

    Ranges are checked in each call before anything is read, also where a condition drops the value. Way out: keep indices inside by `%` or
    `teg.minimum`, and compare with `teg.length`.

    >>> V = teg.array("V")
    >>> teg.evaluate(V[3], {V: [1.0, 2.0]})
    """


class NotDifferentiableError(TegError, ValueError):
    """A derivative that the language does not have.

    The jumps of a floor are differentiated as conditions, one a step, and that takes bounds between which the steps can be enumerated. A
    condition on an integral over the condition's own variable has no slope that is known. Way out: finite or narrower bounds, fewer steps.

    >>> x, t = teg.var("x"), teg.param("t")
    >>> teg.diff(teg.floor(x * t), t)
    """


class DeltaError(TegError, ValueError):
    """A Dirac delta where it has no meaning.

    A delta is defined by its integral, and that is linear in it. A delta may be added and multiplied. It may
    not stand inside a function, a condition or a denominator, and an integral over one of its variables must stand around it.

    >>> teg.sin(teg.delta(teg.var("x")))
    """


class NoReparameterisationError(TegError, ValueError):
    """A Dirac delta on a surface for which no change of variables is known.

    The value of the program, and derivatives that do not move this surface, work. Way out: write the condition so that a variable stands
    alone on one side, or give coordinates in which it does (`teg.Diffeomorphism`, `maps=`).

    >>> x, s, t = teg.var("x"), teg.var("s"), teg.param("t")
    >>> inner = teg.integral(teg.bracket(teg.sin(x) * s < t), (s, 0, x))
    >>> teg.compile(teg.integral(teg.bracket(inner < t), (x, 0, 1)), [t]).grad(t=0.5)
    """


class EstimatorError(TegError, ValueError):
    """An estimator of discontinuous derivatives that does not apply to a program.

    Estimators other than "exact" and "ignore" give first derivatives, none through choices among data, and those that move points inside of
    the integrals need integrals over boxes. Way out: `discontinuities="exact"`, or the estimator that the hint names.

    >>> x, t = teg.var("x"), teg.param("t")
    >>> teg.compile(teg.integral(teg.bracket(x < t), (x, 0, 1)), [t], discontinuities="warp").hessian(t=0.5)
    """


class DiffeomorphismError(TegError, ValueError):
    """A change of variables that is not one-to-one, does not invert as stated, or misses a part of the integral.

    Each map is checked at sample points, because an integral in wrong coordinates has a wrong value. `point` (names and numbers) is the
    sample point where the check failed; `values` holds the expected number and the computed one. Way out: correct `inverse=` or
    `jacobian=`, or narrow `domain=` to where the map is one-to-one.

    >>> x, r = teg.vars("x r")
    >>> teg.Diffeomorphism({x: 2 * r}, inverse={r: x / 3})
    """

    def __init__(
        self,
        what: str,
        where: object = None,
        hint: str = "",
        point: dict[str, float] | None = None,
        values: tuple[float, float] | None = None,
    ) -> None:
        super().__init__(what, where, hint)
        self.point = point
        self.values = values

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.what, self.where, self.hint, self.point, self.values))


class AccuracyError(TegError, ArithmeticError):
    """A result that missed its tolerance or does not converge, in an evaluator made with `inaccurate="raise"`.

    Without that option the call returns the result and warns (`teg.AccuracyWarning`). Way out: a larger `tol=`, or an integrand whose
    singularities stand at bounds.

    >>> x = teg.var("x")
    >>> teg.compile(teg.integral(1 / x, (x, 0, 1)), inaccurate="raise")()
    """


class BackendError(TegError, RuntimeError):
    """A backend that cannot run as it is configured; also the base of `MissingPackageError` and `CompilerError`.

    The backend of JAX needs 64-bit numbers, for instance. Way out: the message names the setting to change.

    >>> import jax
    >>> jax.config.update("jax_enable_x64", False)
    >>> teg.compile(teg.param("t") ** 2, backend="jax")(t=1.0)
    """


class MissingPackageError(BackendError, ImportError):
    """An optional package that is not installed, or is too old.

    Way out: the command in the hint, such as `pip install "teg-compiler[jax]"`.

    >>> import sys
    >>> sys.modules["jax"] = None  # as if JAX were not installed
    >>> teg.jax_function(teg.param("t") ** 2)
    """


class CompilerError(BackendError):
    """The C compiler is missing, cannot be run, or rejects the generated text.

    `hint` holds the compiler's own message. Way out: install a C compiler, name one in the environment variable CC, or take
    `backend="numpy"`.

    >>> import os
    >>> os.environ["CC"] = "'a quote that is not closed"
    >>> teg.compile(teg.param("t") ** 2, backend="c")(t=1.0)
    """


class OptionError(TegError, ValueError):
    """An unknown option, or a value that the option does not take.

    Way out: one of the values that the hint lists.

    >>> teg.compile(teg.param("t") ** 2, backend="fortran")
    """


class InputError(TegError, ValueError):
    """A file, photo or command-line argument that cannot be used.

    Commands print the message and end with exit code 2. Way out: the message names the file and what is expected of it.

    >>> from teg.__main__ import load_expression
    >>> load_expression("no_such_file.py:e")
    """
