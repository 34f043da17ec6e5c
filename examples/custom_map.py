"""A user-defined map: a disk that has been stirred.

    python -m teg.examples.custom_map

The region is (x + ½·sin 2y)² + (y + k·(x + ½·sin 2y)²)² < t, a bean. Neither x nor y stands alone in it, and no formula solves it for
one of them. But it is a disk, u² + v² < t, in the coordinates

    u = x + ½·sin 2y      v = y + k·u²      that is      y = v - k·u²      x = u - ½·sin 2y      dx dy = du dv

each step of which has an explicit inverse, and r² < t in polar coordinates of these. The map has the parameter k, by which the integral
is differentiated too. There are two ways to use it: `change_variables` writes the whole integral in r and φ; `compile(maps=…)` leaves
the value as it is and uses the map where the boundary moves. Without the map the compiler has to search for the boundary. All are
compared with a reference that shares nothing with the compiler: the trapezoidal rule around the disk times Gauss's rule along its
radius.
"""

from __future__ import annotations

import math
import time

import numpy as np

import teg
from teg.evaluator.options import Backend
from teg.ir.expr import Expr

x, y, u, v, r, phi = teg.vars("x y u v r φ")
t, k = teg.params("t k")
DISK = {r: (0, 1), phi: (-math.pi, math.pi)}
"""For t < 1 this contains the region, and lies inside the square: the bounds of x and y need not become brackets."""


def stirring() -> teg.Diffeomorphism:
    """Returns the map from (u, v), where the region is a disk, to (x, y), composed with polar coordinates of (u, v)."""
    down = v - k * u**2
    first = x + teg.sin(2 * y) / 2
    forward = {x: u - teg.sin(2 * down) / 2, y: down}
    stir = teg.Diffeomorphism(forward, inverse={u: first, v: y + k * first**2}, check_at={t: 0.5, k: 0.4})
    return stir @ teg.polar(u, v, r, phi)


def bean() -> Expr:
    """Returns ∫∫ exp(x + y/2) over the region."""
    first = x + teg.sin(2 * y) / 2
    inside = first**2 + (y + k * first**2) ** 2 < t
    return teg.integral(teg.bracket(inside) * teg.exp(x + y / 2), (x, -2, 2), (y, -2, 2))


def reference(area: float, stir: float) -> tuple[float, float, float]:
    """Returns the integral, its derivative by t, and its derivative by k."""
    angle = np.linspace(-math.pi, math.pi, 200, endpoint=False)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    radius = math.sqrt(area) * np.append(0.5 * (nodes + 1.0), 1.0)[:, None]  # the last radius is the circle
    uu, vv = radius * np.cos(angle), radius * np.sin(angle)
    yy = vv - stir * uu**2
    density = np.exp(uu - 0.5 * np.sin(2.0 * yy) + 0.5 * yy)
    by_k = density * (np.cos(2.0 * yy) - 0.5) * uu**2
    rings = [(e * radius).mean(axis=1) * 2.0 * math.pi for e in (density, by_k)]
    value, by_stir = (0.5 * math.sqrt(area) * float(weights @ ring[:-1]) for ring in rings)
    return value, math.pi * float(density[-1].mean()), by_stir


def compare(area: float, stir: float, backend: Backend = "numpy") -> list[tuple[str, tuple[float, float, float], float]]:
    """Returns rows: a title, (integral, ∂/∂t, ∂/∂k), seconds of one evaluation."""
    m = stirring()
    ways = {
        "without the map": teg.compile(bean(), [t, k], backend=backend),
        "compile(maps=[m])": teg.compile(bean(), [t, k], maps=[m], backend=backend),
        "change_variables": teg.compile(teg.change_variables(bean(), m, bounds=DISK, exact=True), [t, k], backend=backend),
    }
    rows = [("reference", reference(area, stir), 0.0)]
    for name, f in ways.items():
        f.value_and_grad(t=area, k=stir)
        start = time.perf_counter()
        value, gradient = f.value_and_grad(t=area, k=stir)
        rows.append((name, (float(value), float(gradient["t"]), float(gradient["k"])), time.perf_counter() - start))
    return rows


def main() -> None:
    """Prints the comparison."""
    area, stir = 0.5, 0.4
    print(f"t = {area}, k = {stir}: integral, ∂/∂t, ∂/∂k, largest error, time")
    rows = compare(area, stir)
    for name, numbers, seconds in rows:
        error = max(abs(a - b) for a, b in zip(numbers, rows[0][1], strict=True))
        print(f"  {name:<18}" + "".join(f"{n:>22.16f}" for n in numbers) + f"{error:>10.1e}{1e3 * seconds:>9.2f} ms")


if __name__ == "__main__":
    main()
