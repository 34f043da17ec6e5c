"""The demos greeks and auction: every number against a closed form."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from teg.__main__ import main

pytest.importorskip("matplotlib")

from teg.examples.auction import BEST, best_reserve, compiled
from teg.examples.greeks import AT, barrier, closed_form, digital, greeks

mp = pytest.importorskip("mpmath")


@pytest.mark.parametrize(("name", "option"), [("digital", digital), ("barrier", barrier)])
def test_all_greeks_are_those_of_the_closed_form(name: str, option: object) -> None:
    found, closed = greeks(option(), AT), greeks(closed_form(name), AT)  # type: ignore[operator]
    assert found == pytest.approx(closed, rel=1e-11)
    assert len(found) == (10 if name == "digital" else 11)


def test_the_closed_form_of_the_digital_option_is_its_own() -> None:
    mp.mp.dps = 30
    normal = mp.ncdf((mp.log(mp.mpf(100) / 105) + (mp.mpf("0.03") - mp.mpf("0.25") ** 2 / 2) / 2) / (mp.mpf("0.25") * mp.sqrt(0.5)))
    assert greeks(closed_form("digital"), AT)["price"] == pytest.approx(float(mp.exp(-mp.mpf("0.015")) * normal), rel=1e-14)


def test_far_from_its_barrier_a_barrier_option_is_a_call() -> None:
    at = AT | {"H": 1e-3}
    root = 0.25 * math.sqrt(0.5)
    d = (math.log(100 / 105) + (0.03 + 0.25**2 / 2) / 2) / root
    call = 100 * float(mp.ncdf(d)) - 105 * math.exp(-0.015) * float(mp.ncdf(d - root))
    assert greeks(barrier(), at)["price"] == pytest.approx(call, rel=1e-10)
    assert greeks(closed_form("barrier"), at)["price"] == pytest.approx(call, rel=1e-12)


def test_plain_automatic_differentiation_finds_no_delta_in_a_digital_option() -> None:
    assert greeks(digital(), AT, discontinuities="ignore")["delta"] == 0


@pytest.mark.parametrize("bidders", [1, 2, 3])
def test_the_best_reserve_price_is_that_of_myerson(bidders: int) -> None:
    path = best_reserve(compiled(bidders, "numpy"))
    assert path[-1] == pytest.approx(BEST, abs=1e-14)
    assert len(path) < 12
    assert compiled(bidders, "numpy", "ignore").grad(r=BEST)["r"] > 0.1


@pytest.mark.parametrize("name", ["greeks", "auction"])
def test_a_demo_writes_its_report(name: str, tmp_path: Path) -> None:
    assert main(["demo", name, "-o", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert report["demo"] == name
    assert (tmp_path / f"{name}.png").exists()
