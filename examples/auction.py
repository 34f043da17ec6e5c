"""The best reserve price of an auction, by Newton's method on its revenue.

    teg demo auction                        (python -m teg.examples.auction runs it without a picture)

In a second-price auction the highest bidder wins, and pays the second highest bid or the reserve price r, whichever is more. Below r no
bidder wins. Values are independent, with the density ρ and the distribution F. Any of n bidders may win, with any other one second:

    R(r) = n(n - 1) ∫∫ [v > r]·[v > w]·max(w, r)·ρ(v)·ρ(w)·F(w)ⁿ⁻² dw dv

Its integrand jumps where the highest value is r: a sale at r, or none. That jump is all that speaks against a higher reserve. Plain
automatic differentiation does not see it, and its slope is positive everywhere. For ρ(v) = ABvᴬ⁻¹(1 - vᴬ)ᴮ⁻¹ the best reserve is
(1 + AB)^(-1/A), for any number of bidders (Myerson 1981). A and B are options, or fitted to values in a file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.errors import InputError
from teg.evaluator.options import Backend, Discontinuities
from teg.ir.expr import Expr

START, STEPS, CONVERGED = 0.6, 40, 1e-14
FEWEST = 5
"""Values that a distribution is fitted to, at least."""

r = teg.param("r")
v, w = teg.vars("v w")


@dataclass(frozen=True)
class Values:
    """The distribution of values between 0 and `highest`, of this one as unit: F(v) = 1 - (1 - vᴬ)ᴮ."""

    a: float = 2.0
    b: float = 3.0
    highest: float = 1.0

    def density(self, v: Any) -> Any:
        """Returns ρ(v), for 0 < v < 1."""
        return self.a * self.b * v ** (self.a - 1) * (1 - v**self.a) ** (self.b - 1)

    def below(self, v: Any) -> Any:
        """Returns F(v)."""
        return 1 - (1 - v**self.a) ** self.b

    @property
    def best(self) -> float:
        """Returns Myerson's reserve price, of `highest` as unit."""
        return float((1 + self.a * self.b) ** (-1 / self.a))


def fitted(values: np.ndarray) -> Values:
    """Returns the distribution under which these values are likeliest; A and B are at least 1."""
    from scipy.optimize import minimize

    highest = values.max() * (1 + 1 / len(values))
    x = values / highest

    def unlikelihood(logs: np.ndarray) -> float:
        a, b = np.exp(logs)
        return -float(np.mean(np.log(a * b) + (a - 1) * np.log(x) + (b - 1) * np.log1p(-(x**a))))

    a, b = np.exp(minimize(unlikelihood, [0.5, 0.5], bounds=[(0, 4), (0, 4)], method="L-BFGS-B").x)
    return Values(float(a), float(b), float(highest))


def read_values(path: Path) -> np.ndarray:
    """Returns the numbers in a text file, separated by commas, semicolons or blanks. Raises InputError if they are no values."""
    try:
        words = [word for word in re.split(r"[\s,;]+", path.read_text(encoding="utf-8")) if word]
    except (OSError, UnicodeDecodeError) as problem:
        raise InputError(f"cannot read {str(path)!r}", None, getattr(problem, "strerror", None) or "a text file of numbers") from None
    try:
        values = np.array([float(word) for word in words])
    except ValueError as problem:
        raise InputError(f"{str(path)!r} has a word that is no number", None, f"numbers only, such as 12.5, 30 ({problem})") from None
    if len(values) < FEWEST or not (np.isfinite(values).all() and values.min() > 0 and np.ptp(values) > 0):
        raise InputError(f"{str(path)!r} has no distribution of values", None, f"at least {FEWEST} positive numbers, not all the same")
    return values


def revenue(bidders: int, values: Values) -> Expr:
    """Returns R for one bidder (a price to take or leave), or more."""
    if bidders == 1:
        alone: Expr = teg.integral(teg.bracket(v > r) * r * values.density(v), (v, 0, 1))
        return alone
    weight = values.density(v) * values.density(w) * values.below(w) ** (bidders - 2)
    sales = teg.integral(teg.bracket((v > r) & (v > w)) * teg.maximum(w, r) * weight, (w, 0, 1), (v, 0, 1))
    both: Expr = bidders * (bidders - 1) * sales
    return both


def compiled(bidders: int, values: Values, backend: Backend, discontinuities: Discontinuities = "exact") -> teg.Evaluator:
    """Returns the compiled revenue."""
    return teg.compile(revenue(bidders, values), [r], backend=backend, discontinuities=discontinuities)


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


def main(backend: Backend = "numpy", values: Values = Values(), most: int = 3) -> list[dict[str, Any]]:
    """Prints the best reserve prices for one, two and `most` bidders, and returns what was found."""
    rows = []
    for bidders in sorted({1, min(2, most), most}):
        f = compiled(bidders, values, backend)
        path = best_reserve(f)
        income = float(f(r=path[-1])) * values.highest
        row = {"bidders": bidders, "path": path, "reserve": path[-1] * values.highest, "revenue": income}
        row["error"] = abs(path[-1] - values.best)
        found = f"reserve {row['reserve']:.15g}, off by {row['error']:.1e}, revenue {income:.12g}, {len(path) - 1} steps"
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

    require_packages("auction demo", {"matplotlib": "matplotlib", "scipy": "scipy"}, progress=False)
    settings = resolved("auction", {"out": out, **options})
    bids = None if settings["values"] is None else read_values(Path(settings["values"]))
    values = Values(settings["rise"], settings["fall"]) if bids is None else fitted(bids)
    folder = result_folder(Path(out))
    rows = main(settings["backend"], values, settings["bidders"])
    draw(rows, values, settings["backend"], folder / "auction.png", bids)
    worst = max(row["error"] for row in rows)
    failure = "" if worst < 1e-8 else f"a reserve price is off by {worst:.1e}"
    summary = [f"best reserve {values.best * values.highest:.6g}, found to {worst:.1e} of the highest value"]
    if bids is not None:
        summary.insert(0, f"{len(bids)} values: A = {values.a:.4g}, B = {values.b:.4g}, at most {values.highest:.6g}")
    report = {"summary": summary, "rows": rows, "distribution": vars(values), "failure": failure, "pictures": ["auction.png"]}
    return finish(folder, "auction", settings, report)


def draw(rows: list[dict[str, Any]], values: Values, backend: Backend, path: Path, bids: np.ndarray | None = None) -> None:
    """Draws revenues over the reserve price with the steps of Newton's method, their slopes, and the values of a file."""
    from matplotlib.figure import Figure

    panels = 2 if bids is None else 3
    figure = Figure(figsize=(5.5 * panels, 4.6), layout="constrained")
    left, right, *others = figure.subplots(1, panels)
    grid, unit = np.linspace(0.005, 0.995, 199), values.highest
    for row, colour in zip(rows, ("#d69e2e", "#2b6cb0", "#3f8f5f"), strict=False):
        n, f = row["bidders"], compiled(row["bidders"], values, backend)
        exact, slope = f.value_and_grad(r=grid)
        plain = compiled(n, values, backend, "ignore").grad(r=grid)["r"]
        left.plot(unit * grid, unit * exact, color=colour, linewidth=2, label=f"{n} bidder{'s' * (n > 1)}")
        left.plot(unit * np.array(row["path"]), unit * f(r=np.array(row["path"])), "o", color=colour, markersize=4)
        right.plot(unit * grid, slope["r"], color=colour, linewidth=2)
        right.plot(unit * grid, plain, color=colour, linewidth=2, linestyle=(0, (2, 2)))
    right.plot([], [], color="#666666", linewidth=2, label="exact")
    right.plot([], [], color="#666666", linewidth=2, linestyle=(0, (2, 2)), label="plain automatic differentiation")
    right.axhline(0, color="#c8ccd2", linewidth=1, zorder=0)
    if bids is not None:
        others[0].hist(bids, bins="auto", density=True, color="#c8ccd2", label="values")
        others[0].plot(unit * grid, values.density(grid) / unit, color="#666666", linewidth=2, label="fitted density")
    titles = ("revenue, and the steps of Newton's method", "its slope", "density of values")
    for axes, title in zip((left, right, *others), titles, strict=False):
        axes.axvline(unit * values.best, color="#c2412d", linewidth=1)
        axes.set_title(title, loc="left", fontsize=11)
        axes.set(xlabel="value" if axes in others else "reserve price", xlim=(0, unit))
        axes.margins(y=0.08)
        axes.legend(frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
