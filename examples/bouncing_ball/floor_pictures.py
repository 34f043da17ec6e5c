"""The picture of flights over an uneven floor: paths in space, the floor at each contact, and the gradients."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from teg.examples.animation import write_animation
from teg.examples.bouncing_ball.floor import Search

BLUE, RED, GREY, LIGHT, BROWN = "#2b6cb0", "#c2412d", "#666666", "#eef1f5", "#8a6d4b"
LEAST = 1e-17  # a gradient of 0 is drawn at this value
AROUND = 0.35  # m of the floor shown on either side of a contact


def draw_flights(path: Path, searches: Mapping[str, Search]) -> None:
    """Draws a panel for each path, and one of the gradients."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5 * len(searches), 10), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(3, len(searches), height_ratios=(2.4, 0.8, 1))
    shared = None
    for k, ((label, search), colour) in enumerate(zip(searches.items(), (BLUE, RED), strict=False)):
        shared = axes = figure.add_subplot(places[0, k], sharex=shared, sharey=shared)
        _draw_flight(axes, search, colour)
        error = search.flight.rebound_error(search.moving)
        axes.set_title(f"{label}\nrebounds off by {error:.1e} m/s" + (f"\n{search.failure}" if search.failure else ""), fontsize=11)
    axes = figure.add_subplot(places[1, :])
    for search, colour in zip(searches.values(), (BLUE, RED), strict=False):
        axes.stairs(search.flight.energies(search.moving), search.flight.knots(search.moving)[0], baseline=None, color=colour, linewidth=2)
    axes.set_ylim(bottom=0, top=1.1 * max(search.flight.energies(search.moving).max() for search in searches.values()))
    axes.set_title("energy of the ball, in J", loc="left", fontsize=11)
    axes.set_xlabel("time in s", color=GREY)
    _plain(axes)
    axes = figure.add_subplot(places[2, :])
    for (label, search), colour in zip(searches.items(), (BLUE, RED), strict=False):
        axes.semilogy(np.maximum(search.gradients, LEAST), color=colour, linewidth=2, marker="o", markersize=3, label=label)
    axes.set_title("largest entry of the gradient of the action, as each method sees it", loc="left", fontsize=11)
    axes.set_xlabel("evaluation", color=GREY)
    axes.grid(axis="y", color=LIGHT)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    _plain(axes)
    figure.savefig(path)


def draw_animation(path: Path, searches: Mapping[str, Search]) -> None:
    """Draws the moving floor and the ball of each search, with the way it has come, as a GIF."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5, 3.8), dpi=100, layout="constrained")
    axes, flight = figure.add_subplot(), next(iter(searches.values())).flight
    x = np.linspace(-0.1 * flight.reach, 1.1 * flight.reach, 300)
    ways = [[np.asarray(part).ravel() for part in search.flight.path(search.moving)] for search in searches.values()]
    floors = np.concatenate([flight.ground(x, np.full_like(x, t))[0] for t in np.linspace(0, flight.duration, 24)])
    low, high = min(w[2].min() for w in ways), max(w[2].max() for w in ways)
    seen = floors[(floors >= 2 * low - high) & (floors <= 2 * high - low)]  # finite, and not far away
    low, high = seen.min(initial=low), seen.max(initial=high)
    axes.set(xlim=x[[0, -1]], ylim=(low - 0.1 * (high - low), high + 0.1 * (high - low)))
    (floor,) = axes.plot(x, flight.ground(x, 0 * x)[0], color=BROWN, linewidth=2.5)
    trails = [axes.plot([], [], color=c, linewidth=1.5, alpha=0.5)[0] for c in (BLUE, RED)[: len(ways)]]
    balls = [axes.plot([], [], "o", color=c, markersize=9, label=label)[0] for c, label in zip((BLUE, RED), searches, strict=False)]
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    axes.set_xlabel("place in m", color=GREY)
    axes.set_ylabel("height in m", color=GREY)
    _plain(axes)

    def update(now: float) -> None:
        floor.set_ydata(flight.ground(x, np.full_like(x, now))[0])
        for trail, ball, (t, along, y) in zip(trails, balls, ways, strict=True):
            at = np.interp(now, t, along), np.interp(now, t, y)
            trail.set_data(np.append(along[t < now], at[0]), np.append(y[t < now], at[1]))
            ball.set_data([at[0]], [at[1]])

    write_animation(path, figure, update, flight.duration)


def _draw_flight(axes: Any, search: Search, colour: str) -> None:
    flight = search.flight
    x = np.linspace(-0.1 * flight.reach, 1.1 * flight.reach, 400)
    rests = np.array_equal(flight.ground(x, 0 * x)[0], flight.ground(x, np.full_like(x, flight.duration))[0])
    ends = [float(flight.ground(x[-1:], np.array([t]))[0][0]) for t in (0.0, flight.duration)]
    above = ("bottom", "top") if ends[0] >= ends[1] else ("top", "bottom")  # labels of nearly the same height do not overlap
    for t, style, side in ((0.0, "solid", above[0]), (flight.duration, (0, (4, 3)), above[1]))[: 1 if rests else 2]:
        height = flight.ground(x, np.full_like(x, t))[0]
        axes.plot(x, height, color=BROWN, linewidth=1, linestyle=style, alpha=0.6)
        axes.annotate(
            "floor" if rests else f"floor, t = {t:.2f} s",
            (x[-1], height[-1]),
            (4, 0),
            textcoords="offset points",
            color=BROWN,
            fontsize=8,
            va="center" if rests else side,
        )
    times, places, heights = flight.knots(search.moving)
    for t, place in zip(times[1:-1], places[1:-1], strict=True):
        near = np.linspace(place - AROUND, place + AROUND, 40)
        axes.plot(near, flight.ground(near, np.full_like(near, t))[0], color=BROWN, linewidth=2.5)
    _, along, y = flight.path(search.moving)
    axes.plot(along.ravel(), y.ravel(), color=colour, linewidth=2)
    axes.plot(places[1:-1], heights[1:-1], "o", color=colour, markersize=6)
    axes.plot(places[[0, -1]], heights[[0, -1]], "o", color="black", markersize=7)
    axes.set_xlabel("place in m", color=GREY)
    axes.set_ylabel("height in m", color=GREY)
    _plain(axes)


def _plain(axes: Any) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY)
