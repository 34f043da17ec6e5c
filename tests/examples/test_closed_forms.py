"""The demos greeks and auction: every number against a closed form."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main

pytest.importorskip("matplotlib")

from teg.examples.auction import Values, best_reserve, compiled, fitted, read_values
from teg.examples.greeks import AT, barrier, closed_form, digital, greeks, market

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


@pytest.mark.parametrize(("bidders", "values"), [(1, Values()), (2, Values()), (3, Values()), (7, Values(1.7, 4.2))])
def test_the_best_reserve_price_is_that_of_myerson(bidders: int, values: Values) -> None:
    path = best_reserve(compiled(bidders, values, "numpy"))
    assert path[-1] == pytest.approx(values.best, abs=1e-12)
    assert len(path) < 12
    assert compiled(bidders, values, "numpy", "ignore").grad(r=values.best)["r"] > 0.01


def test_revenues_are_those_of_simulated_auctions() -> None:
    values, random = Values(1.5, 2.0), np.random.default_rng(0)
    drawn = np.sort((1 - (1 - random.uniform(size=(400_000, 4))) ** (1 / values.b)) ** (1 / values.a), axis=1)
    paid = np.where(drawn[:, -1] > 0.4, np.maximum(drawn[:, -2], 0.4), 0.0)
    assert float(compiled(4, values, "numpy")(r=0.4)) == pytest.approx(paid.mean(), abs=5 * paid.std() / 400_000**0.5)


def test_a_distribution_is_fitted_to_values_in_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random, file = np.random.default_rng(0), tmp_path / "bids.csv"
    drawn = 250 * (1 - (1 - random.uniform(size=20_000)) ** (1 / 3)) ** (1 / 2)
    file.write_text("; ".join(map(repr, drawn.tolist())), encoding="utf-8")
    found = fitted(read_values(file))
    assert found.a == pytest.approx(2, rel=0.05)
    assert found.b / found.highest**found.a == pytest.approx(3 / 250**2, rel=0.5)
    assert found.best * found.highest == pytest.approx(250 * Values().best, rel=0.02)
    file.write_text("10 20 30 25 12 14.5 40", encoding="utf-8")
    assert main(["demo", "auction", "--values", str(file), "--bidders", "1", "-o", str(tmp_path)]) == 0
    assert "7 values" in capsys.readouterr().out
    for text in ("10 twenty 30 40 50", "1 2 3", "1 2 3 4 -5", "2 2 2 2 2 2", ""):
        file.write_text(text, encoding="utf-8")
        assert main(["demo", "auction", "--values", str(file), "-o", str(tmp_path)]) == 2
    assert main(["demo", "auction", "--values", str(tmp_path / "nothing"), "-o", str(tmp_path)]) == 2


def test_options_of_any_market_have_their_greeks_and_impossible_ones_are_refused(tmp_path: Path) -> None:
    at = market({"spot": 40.0, "strike": 38.0, "barrier": 30.0, "volatility": 2.0, "rate": 0.05, "years": 20.0})
    for name, option in (("digital", digital), ("barrier", barrier)):
        assert greeks(option(), at) == pytest.approx(greeks(closed_form(name), at), rel=1e-11)
    for barrier_at in ("100", "104"):  # of a stock at 100, and a strike of 105
        assert main(["demo", "greeks", "--barrier", barrier_at, "-o", str(tmp_path)]) == 2
    assert main(["demo", "greeks", "--strike", "80", "-o", str(tmp_path)]) == 2


@pytest.mark.parametrize("name", ["greeks", "auction"])
def test_a_demo_writes_its_report(name: str, tmp_path: Path) -> None:
    assert main(["demo", name, "-o", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert report["demo"] == name
    assert (tmp_path / f"{name}.png").exists()
