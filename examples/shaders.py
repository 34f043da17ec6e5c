"""One window, several lights: the cost of a new shader when the geometry is compiled already.

    python -m teg.examples.shaders          or      teg demo shaders

A window, turned by an angle and 2·width wide, is lit from behind: E = ∫∫ [|x′| < w]·[|y′| < h]·light(x, y) dx dy with (x′, y′) the
coordinates of the window. The light is a `teg.function`, so the compiler finds the edges of the window, their δ and the breaks of the
integrals once. For the second light it differentiates and compiles the light's formula only. The first column of times shows this, the
second one the same with every light written out by hand. (A quadratic light is integrated by another rule, and is compiled anew.)

The numbers are compared with a reference that shares nothing with the compiler: Gauss's rule in the coordinates of the window, where it
is a rectangle, differentiated by the complex step.
"""

from __future__ import annotations

import cmath
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.evaluator.options import Backend, Functions
from teg.ir.expr import Expr
from teg.ir.function import Function

x, y, u, v = teg.vars("x y u v")
angle, width, contrast = teg.params("angle width contrast")
HEIGHT = 0.4
AT = {"angle": math.pi / 7, "width": 0.7, "contrast": 0.5}
STEP = 1e-100
"""The complex step. Nothing is subtracted, so it may be arbitrarily small."""

Light = Callable[[Any, Any, Any], Any]
Numbers = tuple[float, float, float, float]


@dataclass(frozen=True)
class Row:
    """Brightness and its derivatives by angle, width and contrast; their largest error; seconds until the kernel was ready."""

    name: str
    numbers: Numbers
    error: float
    linked: float
    inlined: float


def lights(of: Any) -> dict[str, Light]:
    """Returns the formulas of the lights, written with the functions of a module: `teg` or `numpy`."""
    return {
        "waves": lambda p, q, k: 1 + k * of.sin(3 * p + 1) * of.cos(2 * q),
        "lamp": lambda p, q, k: k / (1 + 4 * p * p + 4 * q * q) ** 2,
        "dawn": lambda p, q, k: of.exp(k * p) * (1 + of.tanh(q)),
        "sky": lambda p, q, k: 1 + k * (p / 2 + q * q / 4),
    }


def brightness(light: Function) -> Expr:
    """Returns the integral, over a square that contains the window."""
    across = x * teg.cos(angle) + y * teg.sin(angle)
    along = y * teg.cos(angle) - x * teg.sin(angle)
    inside = (across < width) & (across > -width) & (along < HEIGHT) & (along > -HEIGHT)
    return teg.integral(teg.bracket(inside) * light(x, y), (x, -2, 2), (y, -2, 2))


def reference(light: Light, at: dict[str, float], nodes: int = 60) -> tuple[float, float, float, float]:
    """Returns the value and three derivatives."""
    points, weights = np.polynomial.legendre.leggauss(nodes)

    def value(turn: complex, half: complex, k: complex) -> complex:
        across, along = half * points[:, None], HEIGHT * points[None, :]
        p = across * cmath.cos(turn) - along * cmath.sin(turn)
        q = across * cmath.sin(turn) + along * cmath.cos(turn)
        return complex(half * HEIGHT * (weights @ (light(p, q, k) + 0 * p) @ weights))

    point = at["angle"], at["width"], at["contrast"]
    slopes = [value(*(g + STEP * 1j * (i == j) for j, g in enumerate(point))).imag / STEP for i in range(3)]
    return value(*point).real, slopes[0], slopes[1], slopes[2]


def compare(at: dict[str, float], backend: Backend = "numpy") -> list[Row]:
    """Returns a row for each light, in the order of `lights`."""
    rows, kept = [], []
    written, plain = lights(teg), lights(np)
    for name, light in written.items():
        e = brightness(teg.function(name, [u, v], light(u, v, contrast)))
        inlined = ready(e, at, backend, "inlined")[0]  # its evaluator is gone before the other one is made, and with it what they share
        linked, f, numbers = ready(e, at, backend, "linked")
        kept.append(f)  # the compiled geometry is kept as long as one of these evaluators
        error = max(abs(a - b) for a, b in zip(numbers, reference(plain[name], at), strict=True))
        rows.append(Row(name, numbers, error, linked, inlined))
    return rows


def ready(e: Expr, at: dict[str, float], backend: Backend, functions: Functions) -> tuple[float, teg.Evaluator, Numbers]:
    """Returns the seconds until value and gradient are there, the evaluator, and these numbers."""
    start = time.perf_counter()
    f = teg.compile(e, [angle, width, contrast], backend=backend, functions=functions)
    value, gradient = f.value_and_grad(at)
    return time.perf_counter() - start, f, (float(value), float(gradient["angle"]), float(gradient["width"]), float(gradient["contrast"]))


def main(backend: Backend = "numpy") -> list[Row]:
    """Prints the comparison, and returns it."""
    print(", ".join(f"{name} = {value:.4g}" for name, value in AT.items()) + f", backend {backend}")
    heads = ("brightness", "∂/∂angle", "∂/∂width", "∂/∂contrast")
    print("light " + "".join(f"{h:>19}" for h in heads) + f"{'error':>10}{'linked':>11}{'inlined':>11}")
    rows = compare(AT, backend)
    for row in rows:
        numbers = "".join(f"{n:>19.15f}" for n in row.numbers)
        print(f"{row.name:<6}{numbers}{row.error:>10.1e}{1e3 * row.linked:>8.0f} ms{1e3 * row.inlined:>8.0f} ms")
    return rows


def run_shaders(out: str | Path = "out/shaders", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Prints the comparison; draws it to `out`, returns the contents of run.json. It has no progress bar, and nothing is random.

    The options are those of `teg demo shaders` (`examples/options.py`). Raises InputError for those that cannot be used,
    MissingPackageError.
    """
    from teg.examples.harness import finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("shaders demo", {"matplotlib": "matplotlib"}, progress=False)
    settings = resolved("shaders", {"out": out, **options})
    folder = result_folder(Path(out))
    rows = main(settings["backend"])
    draw(rows, folder / "shaders.png")
    worst = max(row.error for row in rows)
    report = {"summary": [f"largest error {worst:.1e}"], "rows": [asdict(row) for row in rows], "pictures": ["shaders.png"]}
    return finish(folder, "shaders", settings, report)


def draw(rows: list[Row], path: Path) -> None:
    """Draws the lights behind the window, and the seconds until each kernel was ready."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 3), layout="constrained")
    places = figure.subplots(1, len(rows) + 1)
    ticks = np.linspace(-0.95, 0.95, 320)
    p, q = np.meshgrid(ticks, ticks)
    turn = AT["angle"]
    across, along = p * math.cos(turn) + q * math.sin(turn), q * math.cos(turn) - p * math.sin(turn)
    inside = (np.abs(across) < AT["width"]) & (np.abs(along) < HEIGHT)
    for axes, (name, light) in zip(places, lights(np).items(), strict=False):
        axes.imshow(np.where(inside, light(p, q, AT["contrast"]) + 0 * p, np.nan), origin="lower", cmap="inferno")
        axes.set_title(name, fontsize=11)
        axes.set(xticks=[], yticks=[], facecolor="0.2")
        axes.spines[:].set_visible(False)
    axes = places[-1]
    for shift, (label, times) in enumerate([("linked", [r.linked for r in rows]), ("inlined", [r.inlined for r in rows])]):
        axes.barh(np.arange(len(rows)) + 0.4 * shift, times, 0.38, label=label, color=("#2b6cb0", "#d69e2e")[shift])
    axes.set_yticks(np.arange(len(rows)) + 0.2, [row.name for row in rows])
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title("seconds to the kernel", fontsize=10)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=2, frameon=False, fontsize=9)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
