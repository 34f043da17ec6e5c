"""Where an expression is not differentiable, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from teg.dump import show
from teg.expr import TRUE, Expr, Param, bracket, positive
from teg.pipeline import flatten, normal_form, program_for
from teg.surfaces import atoms_of

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Diagnosis:
    """One reason why the derivative at a point is not the usual one.

    kind: "tie" (two surfaces, or a surface and a bound, coincide: the gradient given is the mean over the two orders), "parameter
    surface" (a condition on parameters only is at its border), "infinite derivative", "not a number". `index` is the place in the
    batch, flattened.
    """

    kind: str
    surfaces: tuple[str, ...]
    parameters: dict[str, float]
    message: str
    index: int = 0

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


class _Evaluator(Protocol):
    expression: Expr
    wrt: tuple[Param, ...]
    parameters: tuple[str, ...]
    _options: Any

    def outputs(self, orders: int) -> list[Expr]: ...


def diagnose(f: _Evaluator, columns: Sequence[np.ndarray], n: int) -> list[Diagnosis]:
    """One Diagnosis a reason and batch element; runs the gradient, and the conditions on parameters, and watches for ties."""
    import numpy as np

    from teg.backends.numpy_backend import compile_numpy

    outputs = [leaf for e in f.outputs(1) for leaf in flatten(e)]
    border = "a condition on parameters only"
    probes = [
        bracket(positive(a.g, a.strict, TRUE, (show(a.g, 300) + " = 0", border)))
        for a in atoms_of(normal_form(f.expression))
        if not a.g.free and a.resolution is None
    ]
    program = program_for([*outputs, *probes], f.parameters, f._options.tol, f._options.rule)
    kernel = compile_numpy(program)
    found: list[Diagnosis] = []
    for i in range(n):
        element = [c if c.ndim == 0 else c[i : i + 1] for c in columns]
        values = {k: float(c if c.ndim == 0 else c[0]) for k, c in zip(f.parameters, element, strict=True)}
        met = kernel.met_ties(element, 1)
        one, other = (kernel.in_order(element, 1, order)[: len(outputs)] for order in (1, -1))
        differ = not np.allclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True)  # surfaces that merely cross are no tie
        for k in met:
            first, second = program.ties[k].surfaces
            if second != border and not differ:
                continue
            if second == border:
                found.append(Diagnosis("parameter surface", (first,), values, f"the parameters lie on {first}", i))
            else:
                message = f"{first} coincides with {second}; the derivative is the mean over the two orders"
                found.append(Diagnosis("tie", (first, second), values, message, i))
        results = kernel(element, 1)[: len(outputs)]
        if all(np.isfinite(v) for v in values.values()):
            if np.isnan(results).any():
                found.append(Diagnosis("not a number", (), values, "the value or a derivative is not a number here", i))
            elif np.isinf(results).any():
                found.append(
                    Diagnosis("infinite derivative", (), values, "a derivative is infinite here: a region is born or meets a pole", i)
                )
    return found
