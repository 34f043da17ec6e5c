"""The best reserve price of an auction, by Newton's method on its revenue.

    teg demo auction                        (python -m teg.examples.auction runs it without a picture)

In a second-price auction the highest bidder wins, and pays the second highest bid or the reserve price r, whichever is more. Below r nobody
wins. Values are independent, with the density ρ. The revenue of two bidders is twice that of the sales to the first one:

    R(r) = 2 ∫∫ [v > r]·[v > w]·max(w, r)·ρ(v)·ρ(w) dw dv

Its integrand jumps where the highest value is r: a sale at r, or none. That jump is all that speaks against a higher reserve. Plain
automatic differentiation does not see it, and its slope is positive everywhere. For ρ(v) = ABvᴬ⁻¹(1 - vᴬ)ᴮ⁻¹ the best reserve is
(1 + AB)^(-1/A), for any number of bidders (Myerson 1981).
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.evaluator.options import Backend, Discontinuities
from teg.ir.expr import Expr

A, B = 2, 3
BEST = (1 + A * B) ** (-1 / A)
START, STEPS, CONVERGED = 0.6, 20, 1e-14

r = teg.param("r")
values = teg.vars("v w u")


def density(v: Any) -> Any:
    """Returns ρ(v), for 0 < v < 1."""
    return A * B * v ** (A - 1) * (1 - v**A) ** (B - 1)


def revenue(bidders: int) -> Expr:
    """Returns R for one bidder (a price to take or leave), two or three."""
    bids = values[:bidders]
    weight, order = density(bids[0]), bids[0] > r
    for above, bid in pairwise(bids):
        weight, order = weight * density(bid), order & (above > bid)
    paid = teg.maximum(bids[1], r) if bidders > 1 else r
    sales: Expr = teg.integral(teg.bracket(order) * paid * weight, *((bid, 0, 1) for bid in reversed(bids)))
    return math.factorial(bidders) * sales


def compiled(bidders: int, backend: Backend, discontinuities: Discontinuities = "exact") -> teg.Evaluator:
    """Returns the compiled revenue."""
    return teg.compile(revenue(bidders), [r], backend=backend, discontinuities=discontinuities)


def best_reserve(f: teg.Evaluator) -> list[float]:
    """Returns the reserve prices on the way of Newton's method."""
    path = [START]
    while len(path) <= STEPS:
        slope, bend = float(f.grad(r=path[-1])["r"]), float(f.hessian(r=path[-1])["r", "r"])
        step = -slope / bend if bend < 0 else float(np.sign(slope))
        path.append(float(np.clip(path[-1] + step, 0.5 * path[-1], 0.5 * (1 + path[-1]))))
        if abs(path[-1] - path[-2]) < CONVERGED:
            break
    return path


def main(backend: Backend = "numpy") -> list[dict[str, Any]]:
    """Prints the best reserve prices, and returns what was found."""
    rows = []
    for bidders in (1, 2, 3):
        f = compiled(bidders, backend)
        path = best_reserve(f)
        row = {"bidders": bidders, "path": path, "revenue": float(f(r=path[-1])), "error": abs(path[-1] - BEST)}
        found = f"reserve {path[-1]:.15f}, off by {row['error']:.1e}, revenue {row['revenue']:.12f}, {len(path) - 1} steps"
        print(f"{bidders} bidder{'s' * (bidders > 1)}: {found}")
        rows.append(row)
    return rows


def run_auction(out: str | Path = "out/auction", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Finds the best reserve prices, draws; writes to `out`, returns the contents of run.json. It has no progress bar; nothing is random.

    The options are those of `teg demo auction` (`examples/options.py`). Raises InputError for those that cannot be used,
    MissingPackageError.
    """
    from teg.examples.harness import finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("auction demo", {"matplotlib": "matplotlib"}, progress=False)
    settings = resolved("auction", {"out": out, **options})
    folder = result_folder(Path(out))
    rows = main(settings["backend"])
    draw(rows, settings["backend"], folder / "auction.png")
    worst = max(row["error"] for row in rows)
    failure = "" if worst < 1e-8 else f"a reserve price is off by {worst:.1e}"
    report = {"summary": [f"best reserve {BEST:.6f}, found to {worst:.1e}"], "rows": rows, "failure": failure, "pictures": ["auction.png"]}
    return finish(folder, "auction", settings, report)


def draw(rows: list[dict[str, Any]], backend: Backend, path: Path) -> None:
    """Draws revenues over the reserve price with the steps of Newton's method, and their slopes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    grid = np.linspace(0.005, 0.995, 199)
    for row, colour in zip(rows, ("#d69e2e", "#2b6cb0", "#3f8f5f"), strict=True):
        n = row["bidders"]
        exact, slope = compiled(n, backend).value_and_grad(r=grid)
        plain = compiled(n, backend, "ignore").grad(r=grid)["r"]
        left.plot(grid, exact, color=colour, linewidth=2, label=f"{n} bidder{'s' * (n > 1)}")
        left.plot(row["path"], compiled(n, backend)(r=np.array(row["path"])), "o", color=colour, markersize=4)
        right.plot(grid, slope["r"], color=colour, linewidth=2)
        right.plot(grid, plain, color=colour, linewidth=2, linestyle=(0, (2, 2)))
    right.plot([], [], color="#666666", linewidth=2, label="exact")
    right.plot([], [], color="#666666", linewidth=2, linestyle=(0, (2, 2)), label="plain automatic differentiation")
    right.axhline(0, color="#c8ccd2", linewidth=1, zorder=0)
    for axes, title in ((left, "revenue, and the steps of Newton's method"), (right, "its slope")):
        axes.axvline(BEST, color="#c2412d", linewidth=1)
        axes.set_title(title, loc="left", fontsize=11)
        axes.set(xlabel="reserve price", xlim=(0, 1))
        axes.legend(frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
