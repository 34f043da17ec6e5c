"""Reports of missed tolerances: a warning with the estimate, or an error."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

from teg.errors import AccuracyError
from teg.evaluator.arguments import Call
from teg.program import Program, Sample, statements
from teg.program.arrays import ArrayProgram, Run, steps
from teg.program.tabled import TabledProgram

if TYPE_CHECKING:
    import numpy as np

    Results = np.ndarray | Sequence[np.ndarray]

FLOOR = 1e-3
"""The tolerance of a result smaller than this is absolute."""
SLACK = 10.0
"""The factor by which an estimate usually exceeds the error. Estimates are bounds for nearly all programs."""


class AccuracyWarning(UserWarning):
    """A result that missed its tolerance, does not converge, or is not a number although the arguments are finite.

    The result is returned all the same, and the message holds the estimate of its error. Way out: as for `AccuracyError`, which
    `inaccurate="raise"` raises instead; `inaccurate="ignore"` says nothing.

    >>> x = teg.var("x")
    >>> teg.compile(teg.integral(1 / x, (x, 0, 1)))()
    """


def has_samples(program: Program | ArrayProgram | TabledProgram) -> bool:
    """Returns whether integrals of a program are sampled."""
    program = program.program if isinstance(program, TabledProgram) else program
    flat = [program] if isinstance(program, Program) else [s.program for s in steps(program.body) if isinstance(s, Run)]
    return any(isinstance(s, Sample) for p in flat for s in statements(p.body))


def report_missed(
    both: Results, names: Sequence[str], call: Call, how: tuple[float, str], sampled: bool = False, beside: Results | None = None
) -> bool:
    """Warns of, or raises for, the entry of the results that misses its tolerance most. Returns whether any entry misses it.

    `both` are the results, (n, *shape of one), then the estimates of their errors; `names` are titles of the results; `how` is the
    tolerance, and "warn" or "raise"; `sampled` says that integrals of the program are sampled because they are nested too deeply. The
    tolerance is relative to the largest result; to the values `beside` a gradient where that is 0 within its estimate, because it cancels.
    """
    import numpy as np

    values, errors = both[: len(both) // 2], both[len(both) // 2 :]
    results, estimates, (tol, inaccurate) = _rows(values), _rows(errors), how
    with np.errstate(all="ignore"):
        scale = _largest(results)
        if beside is not None:
            scale = np.where(scale <= _largest(estimates), _largest(_rows(beside)), scale)
        excess = estimates / (tol * np.maximum(scale, FLOOR))
    known = call.elements(np.isfinite)
    endless = ~np.isfinite(results) & known
    excess = np.where(endless | (np.isnan(estimates) & known), np.inf, np.where(np.isnan(excess), 0.0, excess))
    if not excess.size or not excess.max() > SLACK:
        return False
    i, j = map(int, np.unravel_index(int(np.argmax(excess)), excess.shape))
    name, place, found = _title(values, names, i), _place(call, j), results[i, j]
    if np.isinf(excess[i, j]) and endless[i, j]:
        what = f"{name} does not converge{place}: the integral seems to diverge (given as {found:g})"
        hint = "is the integrand integrable there? where its singularity has a formula of the variable alone, put it on a bound"
        if np.isnan(found):
            what = f"{name} is not a number{place}: an integral seems to diverge, or has no derivative there"
            hint = "f.diagnose(…) may say why; is the integrand integrable?"
        if not name.startswith("the value"):
            hint = "f.diagnose(…) may say why; a derivative diverges where a singularity that moves reaches a bound, or is not integrable"
    else:
        what = f"{name} misses the tolerance {tol:g}{place}: {found:.10g}, error estimate {estimates[i, j]:.1e}"
        hint = "a larger tol=, a smaller region, or a formula for what the integrand jumps at; f.value_and_error() gives the estimates"
        if sampled:
            hint = 'so many integrals inside each other are sampled: the estimate is a standard error; rule="qmc", order=… asks for that'
    _say(what, hint, inaccurate)
    return True


def report_not_a_number(values: Results, names: Sequence[str], call: Call, inaccurate: str, crowded: bool = False) -> bool:
    """Warns of, or raises for, the first entry of the results that is NaN though no argument is. Returns whether there is one.

    `crowded`: a condition has more roots than are searched for.
    """
    import numpy as np

    if not any(np.isnan(np.min(v, initial=0.0)) for v in ([values] if isinstance(values, np.ndarray) else values)):  # in one pass
        return False
    results = _rows(values)
    missing = np.isnan(results) & call.elements(lambda v: ~np.isnan(v))
    if not missing.any():
        return False
    i, j = map(int, np.unravel_index(int(np.argmax(missing)), missing.shape))
    what = f"{_title(values, names, i)} is not a number{_place(call, j)}"
    hint = (
        "does the expression hold 0/0, inf - inf, a root or a logarithm of a negative number, or a choice from nothing there? f.diagnose(…)"
    )
    if not call.elements(np.isfinite)[j]:
        what += ", where an argument is infinite"
        hint = "give a large number; a bound that is infinite is written so: (x, 0, math.inf)"
    if crowded:
        what += ": a condition has more roots than are looked for"
        hint = "integrate over a smaller region"
    _say(what, hint, inaccurate)
    return True


def _rows(results: Results) -> np.ndarray:
    """Returns every entry of results (n, *shape of one) as a row."""
    import numpy as np

    if isinstance(results, np.ndarray):
        return results
    return np.concatenate([np.moveaxis(v, 0, -1).reshape(-1, len(v)) for v in results])


def _largest(rows: np.ndarray) -> np.ndarray:
    """Returns the largest finite size in each column."""
    import numpy as np

    sizes: np.ndarray = np.where(np.isfinite(rows), np.abs(rows), 0.0)
    return sizes.max(axis=0, initial=0.0)  # type: ignore[no-any-return]


def _title(results: Results, names: Sequence[str], row: int) -> str:
    """Returns the title of a row: a result, or an entry of one."""
    import numpy as np

    for v, name in zip(results, names, strict=False):
        size = math.prod(v.shape[1:])
        if row < size:
            place = np.unravel_index(row, v.shape[1:]) if v.ndim > 1 else ()
            return f"{name}[{', '.join(map(str, map(int, place)))}]" if place else name
        row -= size
    raise AssertionError(row)


def _place(call: Call, j: int) -> str:
    """Returns the place in a batch, in words."""
    shown = [f"{k} = {float(v if v.ndim == 0 else v[j]):.6g}" for k, v in list(zip(call.names, call.columns, strict=True))[:8]]
    return f" at {', '.join(shown)}" + (", …" if len(call.names) > 8 else "") if shown else ""


def _say(what: str, hint: str, inaccurate: str) -> None:
    """Warns the caller, or raises."""
    if inaccurate == "raise":
        raise AccuracyError(what, None, hint)
    warnings.warn(f"{what}\n  hint: {hint}", AccuracyWarning, stacklevel=_level_of_the_caller())


def _level_of_the_caller() -> int:
    """Returns the number of frames up to the first one outside of this package, and of PyTorch, which calls it back,
    for `warnings.warn`."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in (__name__.split(".")[0], "torch"):
        level, frame = level + 1, frame.f_back
    return level
