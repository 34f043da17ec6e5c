"""What a call says where the tolerance was not reached: a warning with the estimate, or an error."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

from teg.errors import AccuracyError

if TYPE_CHECKING:
    import numpy as np

FLOOR = 1e-3
"""Below this size a result's tolerance is absolute."""
SLACK = 10.0
"""An estimate is a bound for nearly all programs: it is about so much larger than the error of the usual one."""


class AccuracyWarning(UserWarning):
    """An integral that did not reach its tolerance, or diverges."""


def report_missed(
    values: np.ndarray,
    errors: np.ndarray,
    names: Sequence[str],
    tol: float,
    inaccurate: str,
    parameters: dict[str, np.ndarray],
    sampled: bool = False,
) -> bool:
    """Warn of the worst result, or raise: `values` and `errors` are (results, n), `names` say what each result is; `sampled`: the program
    has integrals that were sampled because they are too deep. Returns whether there was anything to say."""
    import numpy as np

    with np.errstate(all="ignore"):
        sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
        excess = errors / (tol * np.maximum(sizes.max(axis=0, initial=FLOOR), FLOOR))  # entries of a gradient may cancel
    meant = np.all(np.broadcast_arrays(*map(np.isfinite, parameters.values())), axis=0) if parameters else np.True_
    endless = ~np.isfinite(values) & meant
    excess = np.where(endless, np.inf, np.where(np.isnan(excess), 0.0, excess))
    if not excess.size or not excess.max() > SLACK:
        return False
    i, j = map(int, np.unravel_index(int(np.argmax(excess)), excess.shape))
    place = _place(parameters, j)
    if np.isinf(excess[i, j]) and endless[i, j]:
        what = f"{names[i]} does not converge{place}: the integral seems to diverge (given as {values[i, j]:g})"
        hint = "is the integrand integrable there? where its singularity has a formula of the variable alone, put it on a bound"
        if np.isnan(values[i, j]):
            what = f"{names[i]} is not a number{place}: an integral seems to diverge, or has no derivative there"
            hint = "f.diagnose(…) may say why; is the integrand integrable?"
        if not names[i].startswith("the value"):
            hint = "f.diagnose(…) may say why; a derivative diverges where a singularity that moves reaches a bound, or is not integrable"
    else:
        what = f"{names[i]} misses the tolerance {tol:g}{place}: {values[i, j]:.10g}, error estimate {errors[i, j]:.1e}"
        hint = "a larger tol=, a smaller region, or a formula for what the integrand jumps at; f.value_and_error() gives the estimates"
        if sampled:
            hint = 'so many integrals inside each other are sampled: the estimate is a standard error; rule="qmc", order=… asks for that'
    _say(what, hint, inaccurate)
    return True


def report_not_a_number(
    values: np.ndarray, names: Sequence[str], inaccurate: str, parameters: dict[str, np.ndarray], crowded: bool = False
) -> bool:
    """Warn of the first result, or raise, that is no number though all parameters are: `values` are (results, n), `names` say what
    each is; `crowded`: a condition has more roots than are looked for. Returns whether there was anything to say."""
    import numpy as np

    missing = np.isnan(values)
    if not missing.any():
        return False
    for v in parameters.values():
        missing = missing & ~np.isnan(v)
    if not missing.any():
        return False
    i, j = map(int, np.unravel_index(int(np.argmax(missing)), missing.shape))
    what = f"{names[i]} is not a number{_place(parameters, j)}"
    hint = "does the expression hold 0/0, inf - inf, or a root or a logarithm of a negative number there? f.diagnose(…) may say more"
    if crowded:
        what += ": a condition has more roots than are looked for"
        hint = "integrate over a smaller region"
    _say(what, hint, inaccurate)
    return True


def _place(parameters: dict[str, np.ndarray], j: int) -> str:
    """Where in a batch that is, in words."""
    shown = [f"{k} = {float(v if v.ndim == 0 else v[j]):.6g}" for k, v in list(parameters.items())[:8]]
    return f" at {', '.join(shown)}" + (", …" if len(parameters) > 8 else "") if shown else ""


def _say(what: str, hint: str, inaccurate: str) -> None:
    """Warn the caller, or raise."""
    if inaccurate == "raise":
        raise AccuracyError(what, None, hint)
    warnings.warn(f"{what}\n  hint: {hint}", AccuracyWarning, stacklevel=_level_of_the_caller())


def _level_of_the_caller() -> int:
    """How many frames up the first one outside of this package is, and of PyTorch, which calls it back, as `warnings.warn` counts."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in (__name__.split(".")[0], "torch"):
        level, frame = level + 1, frame.f_back
    return level
