"""What a program computes: the values, and derivatives up to an order or along directions.

    VALUE                             e(p)
    GRADIENT, HESSIAN                 e(p) and ∂e/∂p, and ∂²e/∂p²
    Wanted(False, 1, (u₁, …, uₖ))     Dᵏ⁺¹e(p)[u₁, …, uₖ, ·]: the gradient of the k-th directional derivative

`derivation.py` has the programs of all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from teg.ir.arrays import Array
from teg.ir.expr import Param
from teg.ir.index import ArrayName
from teg.passes.differentiate.through_sums import Parameter


class Wanted(NamedTuple):
    """The outputs of a program: the values, if `values`, and derivatives of order up to `orders`.

    Derivatives are those of the value (if `values`, or if there are no directions) and of its derivative along directions. A direction is
    given by the parameters that move.
    """

    values: bool
    orders: int
    along: tuple[tuple[Parameter, ...], ...] = ()

    @property
    def title(self) -> str:
        """Returns a description of the results, for the log."""
        names = ["value"] * self.values + ["gradient", "Hessian"][: self.orders]
        if self.along:
            directions = "a direction" if len(self.along) == 1 else f"{len(self.along)} directions"
            return f"gradient of the derivative along {directions}"
        return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


VALUE, GRADIENT, HESSIAN = Wanted(True, 0), Wanted(True, 1), Wanted(True, 2)
ORDERS = (VALUE, GRADIENT, HESSIAN)
GRADIENT_ALONE = Wanted(False, 1)


def is_second(wanted: Wanted) -> bool:
    """Returns whether second derivatives are wanted: the Hessian, or its product with a direction."""
    return wanted == HESSIAN or (len(wanted.along) == 1 and wanted.orders == 1)


def derivative_of_order(order: int, wrt: tuple[Parameter, ...]) -> Wanted:
    """Returns the outputs for functions of JAX and PyTorch: values (-1), values and gradients (0), or the derivative along `order`
    directions."""
    return VALUE if order < 0 else GRADIENT if order == 0 else Wanted(False, 1, (wrt,) * order)


def directions_of(wanted: Wanted, known: Sequence[Param | ArrayName]) -> list[dict[Parameter, Parameter]]:
    """Returns the components of each direction, ∂t of t, with names that differ from all `known` ones."""
    names = {p.name for p in known}
    found: list[dict[Parameter, Parameter]] = []
    for k, moving in enumerate(wanted.along):
        mark = "∂" * (k + 1)
        while any(f"{mark}{p.name}" in names for p in moving):
            mark += "′"
        found.append({p: _renamed(p, f"{mark}{p.name}") for p in moving})
        names |= {q.name for q in found[-1].values()}
    return found


def _renamed(p: Parameter, name: str) -> Parameter:
    return Array.make((name, p.dimensions), ()) if isinstance(p, Array) else Param.make(name, ())
