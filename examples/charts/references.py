"""The stored reference values, `references.json`: how they are computed, and reading them.

    python -m teg.examples.charts.references [stability] [regions]

computes them again (mpmath; a few minutes). The regions' integrals are reduced to one dimension by the antiderivative of exp(x), in
pieces between the breaks of `decomposition`, and their derivatives likewise, each root moving by -g_p/g_x. All is computed a second time
with x and y exchanged, and both must agree. The difficult cases have closed forms, which are evaluated with 150 digits and differenced,
at kinks from both sides (the right derivative is then the mean).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from teg.examples.charts.case import Case
from teg.examples.charts.problem import Body, Problem
from teg.examples.charts.regions import INSIDE, REGIONS
from teg.examples.charts.stability import CASES

FILE = Path(__file__).with_name("references.json")
DIGITS, WORKING = 25, 70
AGREEMENT = 1e-21
WORKING_AT_QUARTIC_ENDS = 130  # where roots end like u^(1/4), slopes like u^(-3/4)
CLOSED, STEP = 150, 45  # digits of closed forms, which are differenced over 10⁻⁴⁵ of a parameter: curves that touch leave its root


class Reference:
    """An exact value, and the derivatives by the parameters."""

    def __init__(self, value: str, gradient: Mapping[str, str]) -> None:
        self.value = float(value)
        self.gradient = {name: float(d) for name, d in gradient.items()}


def read(kind: str) -> dict[str, Reference]:
    """Returns the references of the "regions" or of the "stability" cases, by name."""
    return {name: Reference(**entry) for name, entry in json.loads(FILE.read_text(encoding="utf-8"))[kind].items()}


def region_reference(name: str, exchanged: bool = False) -> tuple[Any, dict[str, Any]]:
    """Returns value and derivatives of a region's integral, to WORKING digits except for the rule's error."""
    from mpmath import mp

    from teg.examples.charts.decomposition import conditions, evaluate, inner_breaks, outer_breaks

    problem, degree = REGIONS[name], 2 if name not in ("superellipse", "Perlin pixel") else 4
    indicator = Problem(_indicator(name, exchanged), problem.bounds, problem.parameters)
    exact = {k: mp.mpf(v) for k, v in problem.parameters.items()}
    antiderivative, factor, density = (mp.sin, mp.exp, mp.cos) if exchanged else (mp.exp, mp.cos, mp.exp)

    def motion(x: Any, y: Any, k: int, parameter: str) -> Any:
        """Returns the motion -g_p/g_x of the root x of condition k; g_p by differences over 10^(-dps/3)."""
        polynomials = conditions(indicator, exact, (y,), degree)
        assert polynomials is not None
        h = mp.mpf(10) ** (-mp.dps // 3)
        ahead, behind = (evaluate(indicator, exact | {parameter: exact[parameter] + s * h}, [x, y])[1][k] for s in (1, -1))
        return -(ahead - behind) / (2 * h) / mp.polyval([j * c for j, c in enumerate(polynomials[k])][:0:-1], x)

    def line(y: Any) -> list[Any]:
        """Returns the integral over x, and its derivatives."""
        points = inner_breaks(indicator, exact, (y,), degree)
        inside = [evaluate(indicator, exact, [(a + b) / 2, y])[0] for a, b in pairwise(points)]
        sums = [mp.fsum(i * (antiderivative(b) - antiderivative(a)) for i, (a, b) in zip(inside, pairwise(points), strict=True))]
        for parameter in exact:
            total = mp.mpf(0)
            for (before, after), x in zip(pairwise(inside), points[1:-1], strict=True):
                if before != after:
                    notes = [abs(g) for g in evaluate(indicator, exact, [x, y])[1]]
                    total += (before - after) * density(x) * motion(x, y, notes.index(min(notes)), parameter)
            sums.append(total)
        return [s * factor(y) for s in sums]

    with mp.workdps(WORKING_AT_QUARTIC_ENDS if name == "superellipse" else WORKING):
        breaks = outer_breaks(indicator, exact, degree)
        totals = [mp.mpf(0)] * (1 + len(exact))
        for a, b in pairwise(breaks):
            cache: dict[Any, list[Any]] = {}
            for i in range(len(totals)):
                totals[i] += mp.quad(lambda y, i=i, cache=cache: (cache.get(y) or cache.setdefault(y, line(y)))[i], [a, b])
        return totals[0], dict(zip(exact, totals[1:], strict=True))


def case_reference(case: Case) -> tuple[Any, dict[str, Any]]:
    """Returns value and derivatives of a difficult case, from its closed form."""
    from mpmath import mp

    with mp.workdps(CLOSED):
        at = {k: mp.mpf(v) for k, v in case.problem.parameters.items()}
        gradient = {}
        for name, p in at.items():
            h = mp.mpf(10) ** -STEP * (abs(p) or 1)
            ahead, behind = (case.exact(mp, **at | {name: p + s * h}) for s in (1, -1))  # at a kink: the mean of both sides
            slope = (ahead - behind) / (2 * h)
            noise = AGREEMENT * max(abs(ahead), case.scale) / (abs(p) or 1)
            gradient[name] = mp.mpf(case.infinite.get(name, slope if abs(slope) > noise else 0))
        return +mp.mpf(case.exact(mp, **at)), gradient


def checked_region(name: str) -> tuple[Any, dict[str, Any]]:
    """Returns `region_reference`, computed both ways. Raises ArithmeticError if they disagree."""
    (value, gradient), (again, slopes) = region_reference(name), region_reference(name, exchanged=True)
    if max(abs(value - again), *(abs(gradient[k] - slopes[k]) for k in gradient)) > AGREEMENT:
        raise ArithmeticError(name)
    return value, gradient


def write(kinds: Sequence[str]) -> None:
    """Computes references again, of the "regions", the "stability" cases or both, and stores them."""
    from mpmath import mp

    stored = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    for kind in kinds:
        names = list(REGIONS) if kind == "regions" else [c.name for c in CASES]
        results = map(checked_region, names) if kind == "regions" else map(case_reference, CASES)
        stored[kind] = {
            name: {"value": mp.nstr(value, DIGITS), "gradient": {k: mp.nstr(d, DIGITS) for k, d in gradient.items()}}
            for name, (value, gradient) in zip(names, results, strict=True)
        }
        FILE.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _indicator(name: str, exchanged: bool) -> Body:
    inside = INSIDE[name]
    if exchanged:
        return lambda m, x, y, **values: m.bracket(inside(y, x, **values))
    return lambda m, x, y, **values: m.bracket(inside(x, y, **values))


if __name__ == "__main__":
    write(sys.argv[1:] or ["stability", "regions"])
