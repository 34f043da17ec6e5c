"""The common part of functions of JAX and of PyTorch: names of arguments, reading of calls, and programs for their shapes."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any, ClassVar

from teg.analysis.bodies import write_all_out
from teg.errors import ArrayIndexError, EstimatorError, ParameterError
from teg.evaluator.arguments import by_name, name_of, refuse_masked, refuse_nested
from teg.evaluator.counting import Counting, zeros
from teg.evaluator.kept import Kept
from teg.evaluator.kernels import dimensions_of
from teg.evaluator.options import Options
from teg.evaluator.plan import Plan
from teg.evaluator.wanted import VALUE
from teg.ir.arrays import Array, arrays_of, integer_parameters
from teg.ir.cells import check_indices, with_lengths
from teg.ir.expr import Expr, Param, Tuple
from teg.ir.index import ArrayName, IndexArray
from teg.ir.operands import as_number
from teg.ir.traverse import parameters
from teg.language.checks import check_program
from teg.passes.differentiate.through_sums import outlined
from teg.passes.normalise.sums import NeedsLengths

Parameter = Param | Array
KEPT = 16
"""The number of programs kept for different shapes, integer parameters and index arrays, if these make a difference."""


class FrameworkFunction:
    """A program as a function of the values of its parameters and arrays, by name: the part that does not depend on the framework.

    `_leaves` are the real parameters and arrays, first those by which derivatives are taken, and then the arrays of indices; `_integers`
    are the parameters that hold an integer.
    """

    framework: ClassVar[str]

    def __init__(self, e: Expr, wrt: Sequence[Parameter] | None, options: Options, dtype: str | None, indices: Mapping[Any, Any]) -> None:
        if not options.estimator.has_all_orders:
            name, hint = options.estimator.name, 'here are "exact" and "ignore"; teg.compile has all estimators'
            raise EstimatorError(f"discontinuities={name!r} is not available for functions of {self.framework}", None, hint)
        self.expression = e
        self._given = (e, wrt, options, dtype, dict(indices))
        self._options, self._dtype = options, dtype
        self._program = write_all_out(e)
        counted = dict.fromkeys(integer_parameters(e))
        arrays = arrays_of(e)
        real = [p for p in dict.fromkeys([*parameters(e), *(p for m in options.maps for p in m.parameters)]) if p not in counted]
        every: list[Parameter] = [*real, *(a for a in arrays if isinstance(a, Array))]
        if wrt is not None and (whole := [p for p in wrt if p in counted]):
            raise ParameterError(f"{whole[0].name!r} holds an integer: nothing is differentiable by it", None, "leave it out of the list")
        self.wrt: tuple[Parameter, ...] = tuple(every if wrt is None else wrt)
        self._leaves: tuple[Param | ArrayName, ...] = (
            *self.wrt,
            *(p for p in every if p not in self.wrt),
            *(a for a in arrays if isinstance(a, IndexArray)),
        )
        self._integers: tuple[Param, ...] = tuple(counted)
        self.parameters: tuple[str, ...] = tuple(name_of(p) for p in (*self._leaves, *self._integers))
        self._fixed = by_name(indices)
        static = {p.name for p in self._integers} | {a.name for a in arrays if isinstance(a, IndexArray)}
        if unknown := [k for k in self._fixed if k not in static]:
            hint = "integer parameters and arrays of indices: " + (", ".join(sorted(static)) or "there are none")
            raise ParameterError(f"indices= names {unknown[0]!r}, which is none", None, hint)
        self._plans: Kept[Hashable, Plan] = Kept(KEPT)
        self._counts: Kept[None, Counting] = Kept(1)
        self._plan: Plan | None = None
        self._lock = threading.RLock()
        try:
            self._plan = self._planned(self._outlined(self._program))
        except NeedsLengths:
            return  # a plan for the shapes of each call
        self._plan.program(VALUE)  # programs that cannot be lowered are reported now

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), self._given)

    # -- arguments -----------------------------------------------------------------------------------------------------

    def _values(self, values: Mapping[Any, Any] | None, named: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the value given for each parameter. Raises ParameterError if one is missing, unknown or given twice."""
        if values is not None and not isinstance(values, Mapping):
            text = f"a {self.framework} function is called with a dict, name -> value"
            raise ParameterError(text, None, f"the parameters are {self._signature}")
        given = by_name(values or {})
        for source in (named, self._fixed):
            for k, v in source.items():
                if k in given:
                    raise ParameterError(f"the parameter {k!r} is given twice", None, f"the parameters are {self._signature}")
                given[k] = v
        refuse_nested(given, self.parameters)
        if unknown := [str(k) for k in given if k not in self.parameters]:
            raise ParameterError(
                f"there is no parameter named {', '.join(map(repr, unknown))}", None, f"the parameters are {self._signature}"
            )
        if missing := [k for k in self.parameters if k not in given]:
            raise ParameterError(f"no value for {', '.join(map(repr, missing))}", None, f"the parameters are {self._signature}")
        for k, v in given.items():
            refuse_masked(k, v)
        return given

    @property
    def _signature(self) -> str:
        return ", ".join(self.parameters) or "none"

    # -- programs ------------------------------------------------------------------------------------------------------

    def _plan_for(self, shapes: Mapping[ArrayName, tuple[int, ...]], known: Mapping[str, Any]) -> Plan:
        """Returns the plan for arrays of these shapes: one for all shapes, or one for their lengths if these must be known, and for the
        numbers of candidates that integers and index arrays say. Raises ArrayIndexError if one of these is not `known`."""
        if self._plan is not None and not self._plan.may_need_lengths:
            return self._plan
        counting = self._counts.get(None, lambda: Counting(self._program))
        unknown = [name for name in counting.names if name in known and known[name] is None]
        if unknown and self._plan is not None:
            return self._plan  # second derivatives need to know
        if unknown:
            raise ArrayIndexError(
                f"how many candidates an integral has depends on {unknown[0]}, which {self.framework} traces",
                None,
                f"give it when the function is made: indices={{{unknown[0]!r}: …}}, or close over it",
            )
        numbers = {a.name: zeros(shapes[a]) for a in shapes if isinstance(a, Array)}
        counts = counting.of({**numbers, **known})

        def made() -> Plan:
            return self._planned(self._outlined(with_lengths(counting.bounded(counts), shapes)))

        return self._plans.get((tuple(sorted((a.name, s) for a, s in shapes.items())), counts), made)

    def _outlined(self, e: Expr) -> Expr:
        return outlined(e, self._options.estimator.name == "exact")

    def _planned(self, e: Expr) -> Plan:
        return Plan(e, self._options, self.wrt, self._leaves, self._integers)


def checked_expression(e: object) -> Expr:
    """Returns the program of a user's expression, checked."""
    program = e if isinstance(e, Tuple) else as_number(e)
    check_program(program)
    check_indices(program)
    return program


def check_entries(p: Param | ArrayName, kind: str, dtype: object, shape: tuple[int, ...], hint: str) -> None:
    """Raises an error if a value cannot be that of a parameter or an array, by the kind of its type and its shape.

    Kinds: "i" integers, "f" real numbers, "b" truth values, "" others. `hint` says how to get integers.
    """
    if isinstance(p, IndexArray):
        if kind != "i":
            raise ArrayIndexError(f"the entries of {p.name!r} are indices, and {dtype} was given", None, hint)
    elif not kind:
        raise ParameterError(f"the value of {p.name!r} is not a real number or an array of them: {dtype}")
    if len(shape) < dimensions_of(p):
        raise ParameterError(f"{p.name!r} has {dimensions_of(p)} dimensions, and an array of shape {shape} was given")


def nested(e: Expr, found: Iterator[Any]) -> Any:
    """Returns results in the structure of a tuple expression."""
    return tuple(nested(entry, found) for entry in e.children) if isinstance(e, Tuple) else next(found)
