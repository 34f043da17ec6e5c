"""Where an expression is not differentiable, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from teg.dump import show
from teg.expr import TRUE, Expr, Param, bracket, positive
from teg.integration import Integration
from teg.pipeline import flatten, normal_form, program_for
from teg.program import Isolate, statements
from teg.surfaces import atoms_of

BORDER = "a condition on parameters only"
STEP = 2.0**-50
STEP_OVER_TIES = 2.0**-42
NOTHING = 1e-18
"""Derivatives below that are rounding."""
CHANGE = 1e-3
"""A relative change of the gradient over two relative steps that no smooth function of ordinary curvature makes."""

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Diagnosis:
    """One reason why the derivative at a point is not the usual one.

    kind: "tie" (two surfaces, or a surface and a bound, coincide: the gradient given is the mean over the two orders), "parameter
    surface" (a condition on parameters only is at its border), "one-sided" (the gradient a few roundings away is another one: a region
    is born, two curves cross at a saddle), "infinite derivative", "second derivative", "not a number". `index` is the place in the
    batch, flattened; `iteration` gives the indices of the sums around, in a program with arrays, outermost first, and `parameters` then
    holds the entries that the surfaces are made of, too.
    """

    kind: str
    surfaces: tuple[str, ...]
    parameters: dict[str, float]
    message: str
    index: int = 0
    iteration: dict[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


class _Evaluator(Protocol):
    expression: Expr
    wrt: tuple[Param, ...]
    parameters: tuple[str, ...]
    _options: Any
    _kernels: dict[int, Any]
    _room: dict[tuple[str, int], Integration]

    def outputs(self, orders: int) -> list[Expr]: ...


def diagnose(f: _Evaluator, columns: Sequence[np.ndarray], n: int) -> list[Diagnosis]:
    """One Diagnosis a reason and batch element; runs the gradient (and the Hessian, if the evaluator was asked for one), the conditions on
    parameters, watches for ties, and looks at the gradient a few roundings to either side."""
    import numpy as np

    from teg.backends.numpy_backend import compile_numpy

    orders = 2 if 2 in f._kernels else 1
    outputs = [leaf for e in f.outputs(orders) for leaf in flatten(e)]
    first_order = sum(len(flatten(e)) for e in f.outputs(1))
    probes = [
        bracket(positive(a.g, a.strict, TRUE, (show(a.g, 300) + " = 0", BORDER)))
        for a in atoms_of(normal_form(f.expression))
        if not a.g.free and a.resolution is None
    ]
    program = program_for([*outputs, *probes], f.parameters, f._room.get(("value", orders), f._options.integration))
    kernel = compile_numpy(program)
    searched = any(isinstance(s, Isolate) for s in statements(program.body))  # roots that meet to rounding are a tangency
    found: list[Diagnosis] = []
    for i in range(n):
        element = [c if c.ndim == 0 else c[i : i + 1] for c in columns]
        values = {k: float(c if c.ndim == 0 else c[0]) for k, c in zip(f.parameters, element, strict=True)}
        results, met = kernel.values_and_ties(element, 1)
        results, differ = results[: len(outputs)], False
        if met:  # surfaces that merely cross are no tie
            one, other = (kernel.in_order(element, 1, order)[: len(outputs)] for order in (1, -1))
            differ = not np.allclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True)
        for k in met:
            first, second = program.ties[k].surfaces
            if second != BORDER and not differ:
                continue
            if second == BORDER:
                found.append(Diagnosis("parameter surface", (first,), values, f"the parameters lie on {first}", i))
            else:
                message = f"{first} coincides with {second}; the derivative is the mean over the two orders"
                found.append(Diagnosis("tie", (first, second), values, message, i))
        if all(np.isfinite(v) for v in values.values()):
            gradient, hessian = results[:first_order], results[first_order:]
            if np.isinf(gradient).any():
                found.append(
                    Diagnosis("infinite derivative", (), values, "a derivative is infinite here: a region is born or meets a pole", i)
                )
            elif np.isnan(gradient).any():
                reason = "the value or a derivative is not a number here"
                found.append(Diagnosis("not a number", (), values, reason, i))
            elif not np.isfinite(hessian).all():
                found.append(Diagnosis("second derivative", (), values, "a second derivative is infinite, or not a number, here", i))
            elif not any(d.index == i for d in found):
                found += _one_sided(f, kernel, element, values, results[:first_order, 0], STEP_OVER_TIES if met or searched else STEP, i)
    return found


def _one_sided(
    f: _Evaluator, kernel: Any, element: Sequence[np.ndarray], values: dict[str, float], here: np.ndarray, relative: float, index: int
) -> list[Diagnosis]:
    """The parameters along which the gradient changes at once."""
    import numpy as np

    wrt = {p.name for p in f.wrt}
    found = []
    for k, name in enumerate(f.parameters):
        if name not in wrt:
            continue
        step = relative * (abs(values[name]) or 1.0)
        columns = [np.repeat(np.reshape(c, 1), 2) for c in element]
        columns[k] = columns[k] + np.array([-step, step])
        before, after = kernel(columns, 2)[: len(here)].T
        scale = np.maximum(np.maximum(np.abs(before), np.abs(after)), np.abs(here).max() * 1e-3 + NOTHING)
        change = np.maximum(np.abs(after - before), np.abs(here - 0.5 * (before + after))) / scale
        worst = int(np.nanargmax(change)) if np.isfinite(change).any() else 0
        if np.isfinite(change[worst]) and change[worst] > CHANGE:
            message = (
                f"within {step:.1e} of {name} = {values[name]:.6g} a derivative goes from {before[worst]:.6g} to {after[worst]:.6g}, "
                f"and is given as {here[worst]:.6g}"
            )
            found.append(Diagnosis("one-sided", (), values, message, index))
    return found
