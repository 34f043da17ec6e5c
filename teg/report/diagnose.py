"""Where a program is not differentiable, and why; in a program with arrays, in which iteration of which sums.

`number_watch.py` looks at programs without loops, `loop_watch.py` at those with loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]


BORDER = "a condition on parameters only"
STEP = 2.0**-50
STEP_OVER_TIES = 2.0**-42
NOTHING = 1e-18
"""Smaller derivatives are rounding errors."""
CHANGE = 1e-3
"""A relative change of the gradient over two relative steps that exceeds that of smooth functions of ordinary curvature."""
MOST_NAMED = 8
"""The largest number of parameters that a diagnosis names when it is printed."""


@dataclass(frozen=True)
class Diagnosis:
    """One reason why the derivative at a point is not the usual one.

        f.diagnose(t=1.0, a=0.0)[0].surfaces      # ('t - (x + a·y) = 0', 'the bound y = 1 or the bound x = 1')

    kind: "tie" (two surfaces, or a surface and a bound, coincide: the gradient given is the mean over the two orders, and the message
    tells it beside the one-sided ones), "parameter surface" (a condition on parameters only is at its border), "one-sided" (the gradient a
    few roundings away is another one: a region is born, two curves cross at a saddle), "infinite derivative", "second derivative", "not a
    number", "not looked at" (the gradient takes too many evaluations). `index` is the place in the batch, flattened. In a program with
    arrays `iteration` gives the indices of the sums around, outermost first, and `parameters` holds the entries that the surfaces are
    made of, too. `str()` is a sentence.
    """

    kind: str
    surfaces: tuple[str, ...]
    parameters: dict[str, float]
    message: str
    index: int = 0
    iteration: dict[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        place = ", ".join(f"{name} = {value:.6g}" for name, value in [*self.parameters.items()][:MOST_NAMED])
        place += ", …" if len(self.parameters) > MOST_NAMED else ""
        element = f"in element {self.index} of the batch, " if self.index else ""
        start = f"{element}at {place}, " if place else element
        text = f"{start}{self.message}"
        return f"{text[:1].upper()}{text[1:]}." if start else f"{text}."

    def __repr__(self) -> str:
        return f"<teg.Diagnosis {self.kind}: {self}>"


class Arguments(Protocol):
    """The arguments of a call (`teg.evaluator.arguments.Call`)."""

    @property
    def n(self) -> int: ...
    @property
    def names(self) -> Sequence[str]: ...
    @property
    def doubles(self) -> Sequence[Numbers]: ...
    @property
    def arrays(self) -> Sequence[Numbers]: ...
    @property
    def shapes(self) -> Sequence[tuple[int, ...]]: ...


CREASE = "a surface meets a corner or another surface: second derivatives differ from side to side, and their mean is given"
CREASE_WITHOUT_MEAN = (
    "a surface meets a corner or another surface: second derivatives differ from side to side, and no mean of them is given"
)
MANY_SIDES = "surfaces meet at a corner or at one place: second derivatives have more than two sides, and are not a number"

STRAY = "second derivatives are given that are other ones within a few roundings"


class Second(NamedTuple):
    """What is known of the second derivatives that a call gives at an element: whether they are `finite`, whether they differ from side to
    side (`jumps`), and whether those given are the `mean`."""

    finite: bool
    jumps: bool
    mean: bool

    @property
    def message(self) -> str:
        """Returns in words what is wrong with them; "" if nothing is."""
        if not self.finite:
            return MANY_SIDES if self.jumps else "a second derivative is infinite, or not a number, here"
        return (CREASE if self.mean else CREASE_WITHOUT_MEAN) if self.jumps else "" if self.mean else STRAY


class Element(NamedTuple):
    """One element of a batch, its place in it, the values of its numbers, the program's own values there, and what is known of second
    derivatives, if they were asked for."""

    columns: list[Numbers]
    arrays: list[Numbers]
    number: int
    values: dict[str, float]
    computed: Numbers
    second: Second | None = None


class Look(NamedTuple):
    """The results at an element, the diagnoses of ties that were met, and the distance to go to either side."""

    results: Any
    ties: list[Diagnosis]
    step: float


class Watch(Protocol):
    """A program of values and derivatives that watches for ties, and for the borders of conditions on parameters."""

    def look(self, at: Element) -> Look: ...
    def of_results(self, look: Look, at: Element) -> list[Diagnosis]: ...
    def one_sided(self, look: Look, at: Element) -> list[Diagnosis]: ...


def diagnose(watch: Watch, given: Arguments, computed: Numbers, seconds: Sequence[Second] | None = None) -> list[Diagnosis]:
    """Returns one Diagnosis for each reason, iteration and element: ties, and results that are infinite or NaN; `computed` are the values
    that the call gave, (entries, n), `seconds` tells of the second derivatives of each element.

    If there are none of these: gradients that change within a few roundings.
    """
    import numpy as np

    found: list[Diagnosis] = []
    for i in range(given.n):
        columns = [c if c.ndim == 0 else c[i : i + 1] for c in given.doubles]
        arrays = [a if a.ndim == len(own) else a[i : i + 1] for a, own in zip(given.arrays, given.shapes, strict=True)]
        numbers = {k: float(np.ravel(c)[0]) for k, c in zip(given.names, columns, strict=True)}
        at = Element(columns, arrays, i, numbers, computed[:, i], None if seconds is None else seconds[i])
        look = watch.look(at)
        mine = [*look.ties]
        if all(np.isfinite(v).all() for v in (*columns, *arrays)):
            mine += watch.of_results(look, at)
            if not mine:
                mine += watch.one_sided(look, at)
        found += mine
    return found
