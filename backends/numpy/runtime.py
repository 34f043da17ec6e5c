"""The operations that printed NumPy programs call as `rt`: powers, error functions, ties."""

from __future__ import annotations

import numpy as np

from teg.backends.numpy.arrays import NUMPY
from teg.backends.numpy.lanes import Run, Value
from teg.backends.shared import error_function, rules


def powi(x: Value, n: int) -> Value:
    """Returns x to an integer power."""
    return rules.powi(np, x, n)


def erf(x: Value) -> Value:
    """Returns the error function."""
    return error_function.erf(NUMPY, x)


def erfc(x: Value) -> Value:
    """Returns 1 - erf(x)."""
    return error_function.erfc(NUMPY, x)


def tie(run: Run, g: Value, scale: Value, r: Value, k: int) -> Value:
    """Returns whether g > 0; where g vanishes to rounding, the order of the run decides: that of the surfaces, or all are true or false."""
    near = rules.ties(np, g, scale)
    if not near.any():
        return g > 0.0
    run.met.add(k)
    return rules.resolved(np, near, g, r if run.is_of_surfaces else True, run.order)
