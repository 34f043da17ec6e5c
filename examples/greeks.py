"""A digital and a barrier option with all their Greeks, from one integral each.

    teg demo greeks                         (python -m teg.examples.greeks runs it without a picture)

The price of the stock is S·exp(σw + (q - σ²/2)·τ) at the time τ, where w is normal with the variance τ, under the interest rate q.

    digital = e^(-qτ) ∫ [S_τ > K]·φ(w) dw                        1 if the stock ends above the strike K
    barrier = e^(-qτ) ∫∫ [S_τ > K]·[lowest S > H]·(S_τ - K)·ψ(w, m) dm dw
                                                                 a call that ends if the stock ever falls to H

with the joint density ψ of the end and the minimum of a Brownian motion with drift (by reflection). The payoffs jump, so their Greeks are
integrals over the places of the jumps. Plain automatic differentiation finds no delta in a digital option, and no risk in a barrier.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.errors import InputError
from teg.evaluator.options import Backend, Discontinuities
from teg.ir.expr import Expr, Operand

S, K, H, SIGMA, Q, TAU = PARAMETERS = teg.params("S K H sigma q tau")
AT = {"S": 100.0, "K": 105.0, "H": 90.0, "sigma": 0.25, "q": 0.03, "tau": 0.5}
GREEKS = {"delta": ("S",), "gamma": ("S", "S"), "vega": ("sigma",), "vanna": ("S", "sigma"), "volga": ("sigma", "sigma"), "rho": ("q",)}
GREEKS |= {"theta": ("tau",), "charm": ("S", "tau"), "dual delta": ("K",)}
"""Derivatives of the price; theta and charm by the time that is left."""
FAR = 10
"""Standard deviations that count, on both sides of what the payoff weighs."""

z, down = teg.vars("z down")


def digital() -> Expr:
    """Returns the price of the digital option, as an integral over z = w/√τ."""
    end = S * teg.exp(SIGMA * teg.sqrt(TAU) * z + (Q - SIGMA**2 / 2) * TAU)
    normal = teg.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)
    return teg.exp(-Q * TAU) * teg.integral(teg.bracket(end > K) * normal, (z, -FAR, FAR))


def barrier() -> Expr:
    """Returns the price of the down-and-out call: log(S_τ/S) = σ√τ·z, and the lowest one of log S/σ√τ is min(z, 0) - down."""
    root, drift = SIGMA * teg.sqrt(TAU), (Q / SIGMA - SIGMA / 2) * teg.sqrt(TAU)
    lowest = teg.minimum(z, 0) - down
    reach = z - 2 * lowest

    def joint(growth: Operand) -> Expr:
        """Returns the density times exp(growth·z)."""
        return 2 * reach / math.sqrt(2 * math.pi) * teg.exp(-(reach**2) / 2 + (drift + growth) * z - drift**2 / 2)

    alive = teg.bracket(S * teg.exp(root * lowest) > H) * teg.bracket(S * teg.exp(root * z) > K)
    payoff = alive * (S * joint(root) - K * joint(0))
    return teg.exp(-Q * TAU) * teg.integral(payoff, (down, 0, FAR), (z, drift - FAR, drift + root + FAR))


def closed_form(name: str) -> Expr:
    """Returns the same price in closed form, without integrals (Black and Scholes 1973; Reiner and Rubinstein 1991; H ≤ K)."""
    root = SIGMA * teg.sqrt(TAU)

    def normal(u: Expr) -> Expr:
        return (1 + teg.erf(u / math.sqrt(2))) / 2

    def call(spot: Expr, weight: Expr, power: Expr) -> Expr:
        d = (teg.log(spot / K) + (Q + SIGMA**2 / 2) * TAU) / root
        return weight**power * (S * weight**2 * normal(d) - K * teg.exp(-Q * TAU) * normal(d - root))

    if name == "digital":
        return teg.exp(-Q * TAU) * normal((teg.log(S / K) + (Q - SIGMA**2 / 2) * TAU) / root)
    return call(S, H / H, 0 * Q) - call(H * H / S, H / S, 2 * Q / SIGMA**2 - 1)


def greeks(e: Expr, at: Mapping[str, Any], backend: Backend = "numpy", discontinuities: Discontinuities = "exact") -> dict[str, Any]:
    """Returns the price and all Greeks that the price depends on; without jumps, the first ones only."""
    used = [p for p in PARAMETERS if p in teg.compile(e, backend="numpy").wrt]
    f = teg.compile(e, used, backend=backend, discontinuities=discontinuities)
    given = {p.name: at[p.name] for p in used}
    price, slopes = f.value_and_grad(given)
    bends: dict[Any, Any] = f.hessian(given)
    every = {name: slopes.get(by[0]) if len(by) == 1 else bends.get(by) for name, by in GREEKS.items()}
    if "H" in slopes:
        every["by the barrier"] = slopes["H"]
    return {"price": price, **{name: value for name, value in every.items() if value is not None}}


OPTIONS = {"digital": digital, "barrier": barrier}


def market(settings: Mapping[str, Any]) -> dict[str, float]:
    """Returns the values of the parameters. Raises InputError for a barrier that is not below the stock's price, or above the strike."""
    at = {"S": settings["spot"], "K": settings["strike"], "H": settings["barrier"]}
    at |= {"sigma": settings["volatility"], "q": settings["rate"], "tau": settings["years"]}
    if at["H"] >= at["S"]:
        raise InputError(f"the barrier {at['H']:g} is reached by a stock at {at['S']:g}", None, "--barrier below --spot")
    if at["H"] > at["K"]:
        raise InputError(f"the barrier {at['H']:g} is above the strike {at['K']:g}", None, "the closed form beside it is for others")
    return at


def main(backend: Backend = "numpy", at: Mapping[str, Any] = AT) -> dict[str, dict[str, Any]]:
    """Prints the Greeks beside their closed forms, and returns them."""
    found: dict[str, dict[str, Any]] = {}
    for name, option in OPTIONS.items():
        exact, closed = greeks(option(), at, backend), greeks(closed_form(name), at)
        plain = greeks(option(), at, backend, "ignore")
        print(f"{name:<16}{'integral':>22}{'closed form':>22}{'difference':>12}{'plain AD':>16}")
        for greek, value in exact.items():
            off = abs(value - closed[greek])
            print(f"  {greek:<14}{value:>22.14f}{closed[greek]:>22.14f}{off:>12.1e}{plain[greek]:>16.6f}")
        found[name] = {
            "exact": {k: float(v) for k, v in exact.items()},
            "closed form": {k: float(v) for k, v in closed.items()},
            "plain": {k: float(v) for k, v in plain.items()},
        }
    return found


def run_greeks(out: str | Path = "out/greeks", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Prints and draws the Greeks; writes to `out`, returns the contents of run.json. It has no progress bar, and nothing is random.

    The options are those of `teg demo greeks` (`examples/options.py`). Raises InputError for those that cannot be used,
    MissingPackageError.
    """
    from teg.examples.harness import finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("greeks demo", {"matplotlib": "matplotlib"}, progress=False)
    settings = resolved("greeks", {"out": out, **options})
    at = market(settings)
    folder = result_folder(Path(out))
    found = main(settings["backend"], at)
    draw(settings["backend"], at, folder / "greeks.png")
    worst = max(abs(v - part["closed form"][k]) / max(1.0, abs(v)) for part in found.values() for k, v in part["exact"].items())
    failure = "" if worst < 1e-8 else f"a Greek is off by {worst:.1e} of its closed form"
    report = {"summary": [f"all Greeks within {worst:.1e}"], "options_found": found, "failure": failure, "pictures": ["greeks.png"]}
    return finish(folder, "greeks", settings, report)


def draw(backend: Backend, market: Mapping[str, Any], path: Path) -> None:
    """Draws price, delta and gamma of both over the price of the stock, beside closed forms and plain automatic differentiation."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6.5), layout="constrained")
    places = figure.subplots(2, 3, sharex=True)
    spots = np.linspace(1.01 * market["H"], 1.35 * max(market["S"], market["K"]), 111)
    for row, (name, option) in zip(places, OPTIONS.items(), strict=True):
        at = {**market, "S": spots}
        exact, plain, closed = greeks(option(), at, backend), greeks(option(), at, backend, "ignore"), greeks(closed_form(name), at)
        for axes, greek in zip(row, ("price", "delta", "gamma"), strict=True):
            axes.plot(spots, exact[greek], color="#2b6cb0", linewidth=2.5, label="exact")
            if greek != "price":
                axes.plot(spots, plain[greek], color="#c2412d", linewidth=2.5, label="plain automatic differentiation")
            axes.plot(spots[::10], closed[greek][::10], "o", color="#d69e2e", markersize=5, label="closed form")
            axes.set_title(f"{name}: {greek}", loc="left", fontsize=11)
            axes.ticklabel_format(axis="y", scilimits=(-2, 4), useMathText=True)
            axes.spines[["top", "right"]].set_visible(False)
    for axes in places[1]:
        axes.set_xlabel("price of the stock")
    figure.legend(*places[0, 1].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
