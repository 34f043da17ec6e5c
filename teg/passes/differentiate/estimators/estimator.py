"""What all estimators of discontinuous derivatives share: a name, options that are checked, and the gradient of a program.

An estimator answers one question: the treatment of jumps when a program is differentiated. Each is a pass over the normal form of the
program, and gives an ordinary program without δ, which every backend integrates by the rule that the user chose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import Any, ClassVar

from teg.analysis.settings import Integration
from teg.errors import OptionError
from teg.ir.expr import Expr, Param, Tuple
from teg.ir.simplify import tuple_of
from teg.passes.normalise.choices import has_choices

SAMPLES = 2**14
"""The number of samples of an estimator, if the user names none."""


@dataclass(frozen=True)
class Estimator:
    """A treatment of discontinuities. The fields of a subclass are its options.

    `is_sampled`: its integrals are means over points unless the user names a rule. `has_all_orders`: it gives derivatives of every order,
    and goes through sums over arrays.
    """

    name: ClassVar[str]
    is_sampled: ClassVar[bool] = True
    has_all_orders: ClassVar[bool] = False

    def gradient(self, e: Expr, wrt: Sequence[Param]) -> Tuple:
        """Returns the derivatives of a normal form by each parameter, a tuple; for a tuple e, one such tuple an entry."""
        if isinstance(e, Tuple):
            return tuple_of(*(self.gradient(entry, wrt) for entry in e.children))
        return tuple_of(*self.slopes(e, wrt))

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the derivatives of a number by each parameter."""
        raise NotImplementedError

    def source_of(self, e: Expr) -> Expr | None:
        """Returns the program that is differentiated, cell by cell, in the place of one with arrays; None for one that is not taken.

        Regions of choices among data (`teg.nearest`) are cut, not sampled, so only estimators of all orders take them.
        """
        return None if self.has_all_orders or has_choices(e, inside=True) else e

    def checked(self) -> Estimator:
        """Returns the estimator if its options are in their ranges. Raises OptionError if one is not."""
        return self

    def fitted(self, how: Integration) -> Estimator:
        """Returns the estimator with the options that follow from the integration."""
        return self

    def with_options(self, options: Mapping[str, Any]) -> Estimator:
        """Returns the estimator with these options, by name. Raises OptionError for one that it does not have."""
        known = [f.name for f in fields(self)]
        if unknown := sorted(set(options) - set(known)):
            hint = f"its options: {', '.join(known)}" if known else "it has no options"
            raise OptionError(f"discontinuities={self.name!r} has no option {unknown[0]!r}", None, hint)
        return replace(self, **options).checked()


def check_positive(name: str, value: object) -> None:
    """Raises OptionError for an option that is not a positive number."""
    if isinstance(value, bool) or not isinstance(value, Real) or not 0 < float(value) < float("inf"):
        raise OptionError(f"{name}={value!r} is not a positive number")


def check_count(name: str, value: object, most: int) -> None:
    """Raises OptionError for an option that is not a whole number from 0 to `most`."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise OptionError(f"{name}={value!r} is not a whole number from 0 to {most}")
