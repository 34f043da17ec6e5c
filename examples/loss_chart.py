"""The chart of losses of a descent, with labels at its right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

COLOURS, GREY = ("#2b6cb0", "#c2412d"), "#666666"
ROUNDING = 1e-12  # losses below this are drawn as this
SPACING = 0.17  # of labels, as a fraction of the height


def draw_losses(axes: Any, losses: Mapping[str, Sequence[float]], marks: Mapping[str, float]) -> None:
    """Draws losses after each step on a logarithmic axis, and dashed lines at `marks`, losses to compare with.

    If all are 0 to rounding, it says so instead.
    """
    lines = [(label, values[-1], colour) for (label, values), colour in zip(losses.items(), COLOURS, strict=False)]
    every = [value for values in (*losses.values(), [*marks.values()]) for value in values]
    axes.set_title("squared colour difference per pixel", loc="left", fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    if max(every) <= ROUNDING:
        axes.set_axis_off()
        text = f"0 to rounding from the start (at most {max(every):.0e}): the picture has one colour"
        axes.text(0, 0.85, text, transform=axes.transAxes, color=GREY, fontsize=10, va="top")
        return
    longest = max(1, *(len(values) - 1 for values in losses.values()))
    for values, (_, _, colour) in zip(losses.values(), lines, strict=True):
        shown = values if len(values) > 1 else [*values] * (longest + 1)
        axes.plot(np.maximum(shown, ROUNDING), color=colour, linewidth=2.2)
    for value in marks.values():
        axes.axhline(max(value, ROUNDING), color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
    low, high = np.log(max(min(every), ROUNDING)), np.log(max(every))
    _scale(axes, low, high)
    axes.set_xlim(0, longest)
    axes.set_xlabel("step", fontsize=10, color=GREY)
    axes.tick_params(which="both", colors=GREY, labelsize=9)
    place = -np.inf
    for label, value, colour in sorted(lines + [(label, value, GREY) for label, value in marks.items()], key=lambda line: line[1]):
        place = max((np.log(max(value, ROUNDING)) - low) / max(high - low, 1e-9), place + SPACING)  # labels do not overlap
        at = (0.06 * (high - low) + 0.02 + place * (high - low)) / (1.12 * (high - low) + 0.04)
        text = axes.annotate(f"{label}: {value:.4f}", (1.015, at), xycoords="axes fraction", color=colour, fontsize=9, va="center")
        text.set_in_layout(False)


def _scale(axes: Any, low: float, high: float) -> None:
    """Sets the axis of the losses; their logarithms are between `low` and `high`."""
    from matplotlib.ticker import LogLocator

    axes.set_yscale("log")
    axes.set_ylim(np.exp(low - 0.06 * (high - low) - 0.02), np.exp(high + 0.06 * (high - low) + 0.02))
    axes.yaxis.set_major_locator(LogLocator(subs=range(1, 10) if high - low < 1.6 else (1, 2, 5) if high - low < 5 else (1,)))
    axes.yaxis.set_major_formatter("{x:.3g}")
    axes.yaxis.set_minor_formatter("{x:.3g}" if high - low < 0.3 else "")
