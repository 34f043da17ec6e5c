"""Everything a user can do wrong, one class a mistake, all below `TegError`."""

from __future__ import annotations


class TegError(Exception):
    """A mistake in a program or a call: `what` is wrong, the expression at fault (`where`), and a `hint` at the way out."""

    def __init__(self, what: str, where: object = None, hint: str = "") -> None:
        self.what = what
        self.where = where
        self.hint = hint
        super().__init__(what)

    def __str__(self) -> str:
        lines = [self.what]
        if self.where is not None:
            text = str(self.where)
            lines.append("  in: " + (text if len(text) <= 400 else text[:400] + " …"))
        if self.hint:
            lines.append("  hint: " + self.hint)
        return "\n".join(lines)

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.what, self.where, self.hint))


class OperandError(TegError, TypeError):
    """A value that the language has no operation for."""


class ConditionError(TegError, TypeError):
    """A condition used as a Python truth value, or a number where a condition belongs (and the reverse)."""


class ScopeError(TegError, ValueError):
    """A variable outside its integral, or an integral over something that is not a variable."""


class BoundError(TegError, ValueError):
    """A bound of an integral that cannot be used."""


class NameClashError(TegError, ValueError):
    """One name for two different things."""


class ParameterError(TegError, ValueError):
    """A missing, unknown or repeated parameter, or a value that does not fit."""


class ArrayIndexError(TegError, IndexError):
    """An array indexed by something that is no integer, by too few or too many, or out of its range; a sum of negative length."""


class NotDifferentiableError(TegError, ValueError):
    """A derivative that the language does not have."""


class DeltaError(TegError, ValueError):
    """A Dirac delta where it has no meaning: inside a non-linear function, or in no integral."""


class NoReparameterisationError(TegError, ValueError):
    """A Dirac delta on a surface that no family reduces to one variable."""


class DiffeomorphismError(TegError, ValueError):
    """A change of variables that is none: `point` (names and numbers) is where, and `values` are what should be there and what is."""

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
    """An integral that did not reach its tolerance, or diverges, where the evaluator was told to raise (`inaccurate="raise"`)."""


class BackendError(TegError, RuntimeError):
    """A backend that is missing, or cannot do what was asked."""


class MissingPackageError(BackendError, ImportError):
    """An optional package that is not installed."""


class CompilerError(BackendError):
    """The C compiler is missing or rejected the generated text; its own message is in `hint`."""


class OptionError(TegError, ValueError):
    """An unknown option, or a value outside what the option admits."""


class InputError(TegError, ValueError):
    """A file, photo or command-line argument that cannot be used."""
