"""The chart's points: error, time and evaluations of every method at increasing effort, for every region."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

from teg.errors import OptionError
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend
from teg.examples.charts.ours import call, compiled, evaluations, seconds_in_a_batch
from teg.examples.charts.peers import PEERS, Method, Outcome, best_step, differences, gradient_error, relative_error, split
from teg.examples.charts.problem import Problem, TooManyEvaluationsError
from teg.examples.charts.references import Reference
from teg.examples.charts.regions import REGIONS

MOST = 10**6
"""The most evaluations of one integral by another package. A series ends when the next point would need more."""
QUANTITIES = ("value", "gradient")


@dataclass(frozen=True)
class Series:
    """A method at increasing effort: the settings, and those of a quick run. `rule` names our rule, "" for another package.

    `of_gradients` is its name there, if that is another one. A series that is `differenced` is of gradients only: central differences of
    values by this rule.
    """

    label: str
    rule: str
    settings: Sequence[float]
    quick: Sequence[float]
    of_gradients: str = ""
    differenced: bool = False

    def name(self, quantity: str) -> str:
        """Returns its name in a chart of values or of gradients."""
        return self.of_gradients or self.label if quantity == "gradient" else self.label

    @property
    def quantities(self) -> tuple[str, ...]:
        return QUANTITIES[1:] if self.differenced else QUANTITIES


SIDES, SAMPLES, POINTS = (16, 128, 1024), (100, 10**4, 10**6), (2**8, 2**14, 2**20)
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
SERIES: dict[str, Series] = {
    "auto": Series("Teg, to a tolerance", "auto", (1e-2, 1e-5, 1e-8, 1e-12), (1e-4, 1e-10)),
    "gauss": Series("Teg, Gauss of order n", "gauss", (2, 4, 8, 12, 20), (4, 12)),
    "midpoint": Series("uniform midpoint", "midpoint", SIDES, (16, 32), "our boundary integral, midpoint"),
    "montecarlo": Series("Monte Carlo", "montecarlo", SAMPLES, (100,), "our boundary integral, Monte Carlo"),
    "qmc": Series("quasi-Monte Carlo", "qmc", POINTS, (2**8,), "our boundary integral, quasi-Monte Carlo"),
    "midpoint-differences": Series("uniform midpoint, differences", "midpoint", SIDES, (16,), differenced=True),
    "montecarlo-differences": Series("Monte Carlo, differences", "montecarlo", SAMPLES, (100,), differenced=True),
    "qmc-differences": Series("quasi-Monte Carlo, differences", "qmc", POINTS, (2**8,), differenced=True),
    "dblquad": Series("SciPy dblquad", "", TOLERANCES, (1e-1,)),
    "split": Series("SciPy quad, told the breaks", "", (1e-2, 1e-6, 1e-10, 1e-13), (1e-2,)),
    "cubature": Series("SciPy cubature", "", TOLERANCES, (1e-1,)),
    "vegas": Series("vegas", "", (100, 1000, 10**4, 10**5), (100,)),
}
OTHERS: dict[str, Method] = PEERS | {"split": split}


@dataclass(frozen=True)
class Point:
    """One measurement: `error` relative, `seconds` of one call from Python, `batch_seconds` of one element of a batch of 256 (ours)."""

    region: str
    quantity: str
    method: str
    setting: float
    error: float
    seconds: float
    evaluations: int | None
    batch_seconds: float | None = None

    @property
    def key(self) -> str:
        return point_key(self.region, self.quantity, self.method, self.setting)

    def data(self) -> dict[str, object]:
        return asdict(self) | {"error": self.error if math.isfinite(self.error) else str(self.error)}


def point_key(region: str, quantity: str, method: str, setting: float) -> str:
    return f"{region} | {quantity} | {method} | {setting:g}"


@dataclass(frozen=True)
class Task:
    """All points of one method for one quantity of one region."""

    region: str
    quantity: str
    method: str
    settings: tuple[float, ...]

    @property
    def key(self) -> str:
        return f"{self.region} | {self.quantity} | {self.method}"


def tasks(quick: bool) -> list[Task]:
    """Returns the measurements to make, region by region."""
    return [
        Task(region, quantity, method, tuple(s.quick if quick else s.settings))
        for region in REGIONS
        for quantity in QUANTITIES
        for method, s in SERIES.items()
        if quantity in s.quantities
    ]


def measure(task: Task, exact: Reference, backend: Backend, known: Callable[[str], int | None]) -> Iterator[Point]:
    """Yields the points of a task in the order of effort, except those whose evaluations are `known`; ends early when there are too many.

    A rule that this version of the compiler does not have yields none.
    """
    last = 0
    for setting in task.settings:
        if last > MOST * (2 if task.quantity == "gradient" else 1):
            return
        count = known(point_key(task.region, task.quantity, task.method, setting))
        if count is None:
            try:
                point = _point(task, setting, exact, backend)
            except (OptionError, TooManyEvaluationsError):
                return
            count = point.evaluations or 0
            yield point
        last = count


def prepare(task: Task, backend: Backend) -> None:
    """Compiles the programs of a task, so that the C compiler's cache has them."""
    series, problem = SERIES[task.method], REGIONS[task.region]
    rule = series.rule
    for setting in task.settings if rule else ():
        try:
            f = compiled(problem, rule, setting, backend)
        except OptionError:
            return
        if task.quantity == "gradient" and not series.differenced:
            f.grad(**problem.parameters)
        else:
            f(**problem.parameters)


def _point(task: Task, setting: float, exact: Reference, backend: Backend) -> Point:
    problem, derivatives = REGIONS[task.region], QUANTITIES.index(task.quantity)
    rule = SERIES[task.method].rule
    if SERIES[task.method].differenced:
        return _differenced(task, problem, setting, exact, compiled(problem, rule, setting, backend))
    if rule:
        f = compiled(problem, rule, setting, backend)
        timed = call(f, problem.parameters, derivatives)
        if timed.gradient is None:
            error = relative_error(timed.value, exact.value)
        else:
            error = gradient_error(timed.gradient, exact.gradient)
        batch = seconds_in_a_batch(f, problem.parameters, derivatives) if rule in ("auto", "gauss") else None
        return Point(task.region, task.quantity, task.method, setting, error, timed.seconds, timed.evaluations, batch)
    return _peer_point(task, problem, setting, exact)


def _differenced(task: Task, problem: Problem, setting: float, exact: Reference, f: Evaluator) -> Point:
    """Returns the gradient by central differences of our values by a rule, with the same points on both sides."""
    rule = SERIES[task.method].rule
    count = evaluations(f, problem.parameters, 0) or 0

    def method(problem: Problem, parameters: Mapping[str, float], setting: float, most: float) -> Outcome:
        return Outcome(float(f(**parameters)), evaluations=count)

    value = method(problem, problem.parameters, setting, MOST).value
    slopes, total, seconds = differences(method, problem, setting, best_step(rule, setting, relative_error(value, exact.value)))
    error = gradient_error({k: o.value for k, o in slopes.items()}, exact.gradient)
    return Point(task.region, task.quantity, task.method, setting, error, seconds, total)


def _peer_point(task: Task, problem: Problem, setting: float, exact: Reference) -> Point:
    method = OTHERS[task.method]
    begun = time.perf_counter()
    outcome = method(problem, problem.parameters, setting, MOST)
    seconds = time.perf_counter() - begun
    error = relative_error(outcome.value, exact.value)
    if task.quantity == "value":
        return Point(task.region, task.quantity, task.method, setting, error, seconds, outcome.evaluations)
    step = best_step(task.method, setting, error)
    slopes, count, seconds = differences(method, problem, setting, step, MOST)
    error = gradient_error({k: o.value for k, o in slopes.items()}, exact.gradient)
    return Point(task.region, task.quantity, task.method, setting, error, seconds, count)
