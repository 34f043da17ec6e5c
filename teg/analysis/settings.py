"""Options of integration: tolerance, rule, order and related ones, checked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Any, Literal, TypeGuard

from teg.analysis.isolation import MAX_ROOTS
from teg.errors import OptionError

DEFAULT_TOL = 1e-10
RULES = {
    "auto": "the nodes of its first look at a piece",
    "adaptive": "the nodes of its first look at a piece",
    "gauss": "nodes a piece and variable",
    "midpoint": "points a variable",
    "montecarlo": "samples",
    "qmc": "samples",
}
"""The rules, each with the meaning of `order`."""
Rule = Literal["auto", "adaptive", "gauss", "midpoint", "montecarlo", "qmc"]
"""The type of their names."""
MOST_ROOTS = 4096
"""The largest number of roots of one condition that are searched for. Each takes a place in the loops."""
WIDER = 4
"""The factor by which the room for roots grows when it was too small."""
MAX_ORDER = 64
"""The largest number of nodes of a Gauss rule. Halving a piece is better than more nodes."""


@dataclass(frozen=True)
class Integration:
    """How to integrate: tolerance, rule, order, seed, room for roots and intrinsics.

    `tol` is absolute and relative at once. `order` None means the rule's own choice. `seed` is that of samples. `max_roots` is the first
    number of places for the roots of a condition whose number no theorem bounds. `intrinsics` allows the fast paths of one shape of
    program. Raises OptionError for values outside of their ranges.
    """

    tol: float = DEFAULT_TOL
    rule: str = "auto"
    order: int | None = None
    seed: int = 0
    max_roots: int = MAX_ROOTS
    intrinsics: bool = True

    def __post_init__(self) -> None:
        tol: Any = self.tol
        if isinstance(tol, bool) or not isinstance(tol, Real) or not 0 < float(tol) < 1:
            raise OptionError(f"tol={tol!r} is not a tolerance", None, "a number between 0 and 1, such as 1e-10")
        object.__setattr__(self, "tol", float(tol))
        if not isinstance(self.rule, str) or self.rule not in RULES:
            raise OptionError(f"rule={self.rule!r} is not known", None, "one of: " + ", ".join(RULES))
        order: Any = self.order
        if order is not None:
            most = MAX_ORDER if self.rule in ("auto", "adaptive", "gauss") else 2**35
            least = 4 if self.rule in ("auto", "adaptive") else 1  # with 4 nodes and more the error can be estimated
            if not is_whole(order) or not least <= order <= most:
                meaning = f"order= is {RULES[self.rule]} with rule={self.rule!r}"
                raise OptionError(f"order={order!r} is not a whole number from {least} to {most}", None, meaning)
            object.__setattr__(self, "order", int(order))
        if not is_whole(self.seed) or not 0 <= self.seed < 2**32:
            raise OptionError(f"seed={self.seed!r} is not a seed", None, "a whole number from 0 to 2³² - 1")
        if not is_whole(self.max_roots) or not 1 <= self.max_roots <= MOST_ROOTS:
            raise OptionError(f"max_roots={self.max_roots!r} is not a number of roots", None, "1 to 4096; each takes a place in the loops")
        if not isinstance(self.intrinsics, bool):
            raise OptionError(f"intrinsics={self.intrinsics!r} is not known", None, "True or False")
        object.__setattr__(self, "seed", int(self.seed))
        object.__setattr__(self, "max_roots", int(self.max_roots))

    @property
    def closed_forms(self) -> bool:
        """Returns whether an integral may be computed by an intrinsic, without a rule: only if the user chose no rule."""
        return self.intrinsics and self.rule == "auto" and self.order is None


def with_more_room(how: Integration) -> Integration | None:
    """Returns the same options with more room for roots; None if the room is at its maximum."""
    return replace(how, max_roots=min(WIDER * how.max_roots, MOST_ROOTS)) if how.max_roots < MOST_ROOTS else None


def is_whole(value: object) -> TypeGuard[int]:
    """Returns whether a value is an integer, of Python or NumPy."""
    return isinstance(value, Integral) and not isinstance(value, bool)
