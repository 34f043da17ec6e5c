"""A few named numbers by L-BFGS: what the scenes share that recover them from a picture."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.examples.replay import Keep

Numbers = Mapping[str, float]
Picture = npt.NDArray[np.float64]

BLUE, GREY = "#2b6cb0", "#666666"
LEAST = 1e-18


@dataclass
class Fit:
    """Numbers and losses, one for each evaluation and the best at the end, pictures with their titles, seconds of the descent."""

    numbers: list[dict[str, float]] = field(default_factory=list)
    losses: list[float] = field(default_factory=list)
    pictures: dict[str, Picture] = field(default_factory=dict)
    seconds: float = 0.0


Loss = Callable[[dict[str, float]], tuple[float, Mapping[str, Any]]]
"""From named numbers to a loss and its derivatives by them, and perhaps by others."""


def fit(loss_and_slopes: Loss, start: Numbers, steps: int, keep: Keep, name: str = "loss") -> Fit:
    """Returns the descent of a loss of named numbers from a start; `keep` keeps its evaluations by this name. Needs SciPy."""
    from scipy.optimize import minimize

    names, found = list(start), Fit()

    def named(point: Any) -> dict[str, float]:
        return dict(zip(names, map(float, point), strict=True))

    def evaluated(point: Any) -> Any:
        value, slopes = loss_and_slopes(named(point))
        return np.array([value, *(float(slopes[name]) for name in names)])

    kept = keep(name, evaluated)

    def objective(point: Any) -> tuple[float, Any]:
        value, *slopes = kept(point)
        found.numbers.append(named(point))
        found.losses.append(float(value))
        return float(value), np.array(slopes)

    options = {"maxiter": steps, "ftol": 1e-16, "gtol": 1e-10}
    begun = time.perf_counter()
    end = minimize(objective, np.array([start[name] for name in names]), jac=True, method="L-BFGS-B", options=options)
    found.seconds = time.perf_counter() - begun
    found.numbers.append(named(end.x))
    found.losses.append(float(end.fun))
    return found


def lines_of(found: Fit, true: Numbers) -> list[str]:
    """Returns the loss and the numbers in words."""
    ends = f"loss {found.losses[0]:.6g} -> {found.losses[-1]:.3g} after {len(found.losses) - 1} evaluations"
    start, end = found.numbers[0], found.numbers[-1]
    return [ends, *(f"{name:<9}{start[name]:>8.3f} -> {end[name]:>12.8f}   picture {true[name]:>6.3f}" for name in true)]


def draw_losses(axes: Any, found: Fit) -> None:
    """Draws the losses; those below `LEAST` are drawn at it."""
    from matplotlib.ticker import MaxNLocator

    axes.semilogy(np.maximum(found.losses, LEAST), color=BLUE, linewidth=2)
    axes.set_title("loss", loc="left", fontsize=11)
    axes.set_xlabel("evaluation", color=GREY)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(which="both", colors=GREY)


def draw_pictures(axes: Any, found: Fit) -> None:
    """Draws one picture in each of the axes, the first row at the bottom, all in the same shades."""
    most = max(1.0, *(float(picture.max()) for picture in found.pictures.values()))
    for axis, (title, picture) in zip(axes, found.pictures.items(), strict=False):
        axis.imshow(picture, origin="lower", cmap="gray", vmin=0, vmax=most, interpolation="nearest")
        axis.set_title(title, fontsize=11)
        axis.set(xticks=[], yticks=[])
        axis.spines[:].set_color("#c8ccd2")
