"""The directions of products with second derivatives: named parameters, with a number or an array for each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from teg.errors import ParameterError
from teg.evaluator.arguments import as_entries, as_floats, by_name
from teg.evaluator.wanted import Wanted, directions_of
from teg.ir.arrays import Array
from teg.ir.expr import Param
from teg.ir.index import ArrayName
from teg.passes.differentiate.through_sums import Parameter


def shape_of(p: Parameter, given: Mapping[str, Any]) -> tuple[int, ...]:
    """Returns the shape of a parameter among the values of a call, without a batch."""
    return as_entries(p, given[p.name], "float64").shape[-p.dimensions :] if isinstance(p, Array) else ()


def units(p: Parameter, given: Mapping[str, Any]) -> Iterator[Any]:
    """Yields a direction for each of the entries of a parameter."""
    import numpy as np

    shape = shape_of(p, given)
    for place in np.ndindex(*shape):
        direction = np.zeros(shape)
        direction[place] = 1.0
        yield direction


def generic(wrt: Sequence[Parameter], given: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a direction along all parameters whose components have no order, so that no few of them cancel."""
    import numpy as np

    random = np.random.default_rng(len(wrt))
    found: dict[str, Any] = {}
    for p in wrt:
        shape = shape_of(p, given)
        found[p.name] = random.choice([-1.0, 1.0], shape) * random.uniform(0.5, 1.0, shape)
    return found


@dataclass(frozen=True)
class Directions:
    """The directions along which a program is differentiated: by the parameters `wrt`, among all its parameters `leaves`."""

    wrt: Sequence[Parameter]
    leaves: Sequence[Param | ArrayName]

    def named(self, direction: Mapping[Any, Any]) -> dict[str, Any]:
        """Returns a direction by name. Raises ParameterError for a parameter by which no derivative is taken, or for what is no dict."""
        if not isinstance(direction, Mapping):
            raise ParameterError(f"a direction is a dict name -> number or array, and {direction!r:.80} was given")
        moved, names = by_name(direction), [p.name for p in self.wrt]
        if unknown := sorted(moved.keys() - set(names)):
            raise ParameterError(f"no derivative is taken by {unknown[0]!r}", None, "derivatives are taken by " + ", ".join(names))
        return moved

    def components(self, given: Mapping[str, Any], direction: Mapping[Any, Any], dtype: str) -> dict[str, Any]:
        """Returns a direction by name, as numbers and arrays. Raises ParameterError for another shape than that of an array parameter."""
        found = {k: as_floats(f"the direction along {k}", d, dtype)[()] for k, d in self.named(direction).items()}
        for p in self.wrt:
            if isinstance(p, Array) and p.name in found:
                shape, own = shape_of(p, given), found[p.name].shape
                if own[-p.dimensions :] != shape:
                    raise ParameterError(f"the direction along {p.name} has the shape {own}, {p.name} has {shape}")
        return found

    def moved(self, given: dict[str, Any], direction: Mapping[str, Any]) -> tuple[Wanted, dict[str, Any]]:
        """Returns the product with a direction, and the values with the components of the direction added."""
        moved = self.named(direction)
        which = tuple(p for p in self.wrt if p.name in moved)
        wanted = Wanted(False, 1, (which,))
        (components,) = directions_of(wanted, self.leaves)
        return wanted, {**given, **{components[p].name: moved[p.name] for p in which}}
