"""The bouncing-ball demo: the action and its gradient, the exact path, the descent with and without jumps."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teg.__main__ import main
from teg.errors import InputError, MissingPackageError

pytest.importorskip("scipy")
pytest.importorskip("matplotlib")
pytest.importorskip("tqdm")


from teg.examples.bouncing_ball import run
from teg.examples.bouncing_ball.descent import SHORTEST, ActionDescent
from teg.examples.bouncing_ball.run import run_bouncing_ball
from teg.examples.bouncing_ball.scene import CompiledScene, compile_scene, contact_names, height_names
from teg.examples.bouncing_ball.throw import Throw, exact, make_throw, straight

QUICK: dict[str, Any] = {"backend": "numpy", "progress": False}


@cache
def scene_of(contacts: int, discontinuities: Any = "exact") -> CompiledScene:
    return compile_scene(contacts, "numpy", discontinuities)


@pytest.fixture(autouse=True, scope="module")
def _compiled_once() -> Iterator[None]:
    """Scenes do not depend on the duration: only smoothed derivatives do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "compile_scene", lambda contacts, _backend, discontinuities, _seconds: scene_of(contacts, discontinuities))
        yield
    scene_of.cache_clear()


@pytest.fixture
def _not_drawn() -> Iterator[None]:
    """For tests that look at no picture."""
    from PIL import Image

    def blank(folder: Path, *_: object) -> None:
        for name in (run.SHEET, run.ANIMATION):
            Image.new("RGB", (1, 1)).save(folder / name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "_draw", blank)
        yield


def descent_of(throw: Throw, discontinuities: str = "exact") -> ActionDescent:
    return ActionDescent(throw, scene_of(throw.contacts, discontinuities))


def values(descent: ActionDescent, times: np.ndarray, heights: np.ndarray) -> dict[str, float]:
    names = contact_names(len(times)) + height_names(len(times))
    return dict(zip(names, [*times, *heights], strict=True)) | descent.given


# -- the action --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("contacts", [1, 2, 5])
def test_the_action_of_the_exact_path_is_the_sum_over_its_parabolas(contacts: int) -> None:
    throw = make_throw(contacts, 1.5)
    times, heights, action = exact(throw)
    descent = descent_of(throw)
    value, slopes = descent.scene.action.value_and_grad(values(descent, times, heights))
    assert value == pytest.approx(action, rel=1e-13)
    assert max(abs(s) for s in slopes.values()) < 1e-10  # of a path of least action


def test_the_energy_of_the_exact_path_is_the_same_at_all_times_seen_from_inside() -> None:
    throw = make_throw(4, -1.5)
    times, heights, _ = exact(throw)
    t = np.linspace(0, throw.duration, 200)
    assert np.ptp(throw.energy(times, heights, t)) < 1e-9
    first = throw.path(times, heights, np.array([0.0, 1e-6]))
    start = throw.mass * (((first[1] - first[0]) / 1e-6 - throw.speed) ** 2 / 2 + throw.gravity * throw.start)
    assert throw.energy(times, heights, t)[0] == pytest.approx(start, rel=1e-5)


def test_the_gradient_agrees_with_differences_of_the_action() -> None:
    throw = make_throw(3, 1.5)
    descent = descent_of(throw)
    times, heights = straight(throw)
    place = values(descent, times + np.array([0.02, -0.03, 0.05]), heights + np.array([0.1, -0.2, 0.3, 0.05]))
    slopes = descent.scene.action.grad(place)
    h = 1e-6
    for name in contact_names(3) + height_names(3):
        ahead, behind = (descent.scene.action(place | {name: place[name] + s * h}) for s in (1, -1))
        assert slopes[name] == pytest.approx((ahead - behind) / (2 * h), rel=1e-7, abs=1e-7)


def test_ignoring_jumps_loses_the_jump_of_the_kinetic_energy() -> None:
    throw = make_throw(3, 1.5)
    exactly, plainly = descent_of(throw), descent_of(throw, "ignore")
    times, heights = straight(throw)
    place = values(exactly, times, heights)
    whole, seen = exactly.scene.action.grad(place), plainly.scene.action.grad(place)
    before, after = throw.contact_speeds(times, heights)
    for name, v, w in zip(contact_names(3), before, after, strict=True):
        assert whole[name] - seen[name] == pytest.approx(throw.mass * (v**2 - w**2) / 2, rel=1e-12)
    for name in height_names(3):
        assert whole[name] == pytest.approx(seen[name], rel=1e-12)


@pytest.mark.parametrize(("kind", "law"), [("exact", (0.5, 2)), ("ignore", (1, 1))])
def test_at_the_best_heights_the_gradient_is_the_law_of_rebounds(kind: str, law: tuple[float, float]) -> None:
    throw = make_throw(3, 1.5)
    descent = descent_of(throw, kind)
    descent.step()  # of the heights
    end = descent.states[-1]
    before, after = throw.contact_speeds(end.times, end.heights)
    factor, walls = law
    expected = factor * throw.mass * (after - before) * (after + before - walls * throw.speed)
    np.testing.assert_allclose(end.gradient, expected, rtol=1e-11, atol=1e-11)


# -- the exact path ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [1.0, 0.7])
@pytest.mark.parametrize("speed", [0.0, 1.5, -2.0])
@pytest.mark.parametrize("contacts", [1, 2, 3, 6])
def test_the_exact_path_falls_freely_and_rebounds(contacts: int, speed: float, restitution: float) -> None:
    throw = make_throw(contacts, speed, restitution=restitution)
    times, heights, _ = exact(throw)
    before, after = throw.contact_speeds(times, heights)
    np.testing.assert_allclose(after - speed, -restitution * (before - speed), rtol=1e-11)
    assert (np.diff(times) > 0).all()
    t, h = np.linspace(0, throw.duration, 2001)[1:-1], 1e-4
    smooth = t[np.abs(t[:, None] - times).min(axis=1) > 2 * h]
    around = [throw.path(times, heights, smooth + s) for s in (-h, 0, h)]
    np.testing.assert_allclose((around[0] - 2 * around[1] + around[2]) / h**2, -throw.gravity, rtol=1e-5)
    inside = around[1] - speed * smooth
    assert (inside > 0).all()
    assert contacts == 1 or (inside < throw.room).all()
    ends = throw.path(times, heights, np.array([0.0, np.nextafter(throw.duration, 0)]))
    np.testing.assert_allclose(ends, [throw.start, throw.arrival], rtol=1e-12)


# -- the descent -------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("_not_drawn")
@pytest.mark.parametrize(("contacts", "speed", "share"), [(1, 1.5, 0.7), (2, -1.0, 0.7), (3, 1.5, 0.7), (4, 0.5, 0.4), (3, 1.0, 0.95)])
def test_least_action_is_the_exact_path(contacts: int, speed: float, share: float, tmp_path: Path) -> None:
    duration = make_throw(contacts, speed).duration * share / 0.7
    report = run_bouncing_ball(contacts=contacts, speed=speed, duration=duration, out=tmp_path, alone=True, **QUICK)
    assert report["converged"]
    assert report["largest_time_error"] < 1e-9
    assert abs(report["action_above_exact"]) < 1e-11
    assert report["smallest_curvature"] > 0  # a minimum
    np.testing.assert_allclose(report["heights"], report["exact"]["heights"], atol=1e-8)
    np.testing.assert_allclose(report["speed_of_lift_by_rebounds"], speed, atol=1e-7)


@pytest.mark.usefixtures("_not_drawn")
@pytest.mark.parametrize(("contacts", "restitution"), [(1, 0.5), (3, 0.8), (5, 0.6)])
def test_contacts_that_take_energy(contacts: int, restitution: float, tmp_path: Path) -> None:
    report = run_bouncing_ball(contacts=contacts, restitution=restitution, out=tmp_path, alone=True, **QUICK)
    assert report["converged"]
    assert report["largest_time_error"] < 1e-10
    np.testing.assert_allclose(report["speed_of_lift_by_rebounds"], 1.5, atol=1e-7)
    throw = Throw(**report["throw"])
    times, heights = np.array(report["times"]), np.array(report["heights"])
    middles = (throw.knots(times)[0][:-1] + throw.knots(times)[0][1:]) / 2
    np.testing.assert_allclose(np.diff(throw.energy(times, heights, middles)), -throw.losses(times, heights), rtol=1e-7)


@pytest.mark.parametrize(("contacts", "speed", "restitution"), [(1, 1.5, 1.0), (5, -4.0, 1.0), (9, 1.5, 0.8), (6, 0.0, 0.3)])
def test_newtons_method_takes_few_steps(contacts: int, speed: float, restitution: float) -> None:
    throw = make_throw(contacts, speed, restitution=restitution)
    descent = descent_of(throw)
    assert not run.descend(descent, 10, progress=False)
    assert descent.converged
    assert np.abs(descent.states[-1].times - exact(throw)[0]).max() < 1e-10


def test_the_slopes_of_losses_are_those_by_differences() -> None:
    throw = make_throw(3, 1.5, restitution=0.7)
    times, heights = straight(throw)
    at, slopes, h = np.concatenate([times, heights]), throw.slopes_of_losses(times, heights), 1e-6
    for k, unit in enumerate(np.eye(len(at))):
        ahead, behind = (throw.losses(*np.split(at + s * h * unit, [3])) for s in (1, -1))
        np.testing.assert_allclose(slopes[:, k], (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-6)


def test_a_path_that_leaves_the_lift_is_no_success(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["--contacts", "5", "--duration", "2.95", "--backend", "numpy", "--alone", "-o", str(tmp_path)]
    assert main(["demo", "bouncing-ball", *words]) == 3
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert "outside of the lift" in error


def test_the_longest_flight_just_reaches_everything() -> None:
    for contacts in (1, 2, 3, 4):
        with pytest.raises(InputError, match="no ball makes") as error:
            make_throw(contacts, 0.0, 99.0, 0.7)
        longest = float(str(error.value.hint).split("at most ")[1].split(" s")[0])
        throw = make_throw(contacts, 0.0, longest - 1e-3, 0.7)
        times, heights, _ = exact(throw)
        assert (np.diff(throw.knots(times)[0]) > 0).all()
        highest = [throw.path(times, heights, np.linspace(a, b, 200)[:-1]).max() for a, b in pairwise(times)]
        assert all(h <= throw.room + 1e-9 for h in highest)


@pytest.mark.parametrize("speed", [1.5, -1.0])
def test_without_jumps_the_ball_rebounds_as_if_the_lift_had_half_its_speed(speed: float, tmp_path: Path) -> None:
    report = run_bouncing_ball(contacts=3, speed=speed, out=tmp_path, **QUICK)
    beside = report["beside"]
    assert beside["converged"]
    np.testing.assert_allclose(beside["speed_of_lift_by_rebounds"], speed / 2, atol=1e-8)
    assert "half its speed" in beside["note"]
    assert beside["largest_time_error"] > 0.01 > 1e6 * report["largest_time_error"]
    assert beside["action"] > report["action"] + 0.1
    assert report["note"] == ""
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8")) == report
    assert (tmp_path / "bouncing_ball.png").stat().st_size > 10_000


@pytest.mark.usefixtures("_not_drawn")
def test_in_a_lift_at_rest_half_of_nothing_is_right(tmp_path: Path) -> None:
    report = run_bouncing_ball(contacts=2, speed=0.0, out=tmp_path, **QUICK)
    assert report["beside"]["largest_time_error"] < 1e-9
    assert "at rest" in report["beside"]["note"]


@pytest.mark.usefixtures("_not_drawn")
def test_the_contacts_do_not_depend_on_the_lifts_speed(tmp_path: Path) -> None:
    duration = make_throw(3, 0.0).duration
    options: dict[str, Any] = {"contacts": 3, "duration": duration, "out": tmp_path, "alone": True, **QUICK}
    found = [run_bouncing_ball(speed=speed, **options)["times"] for speed in (0.0, 2.0, -3.0)]
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-9)


def test_no_step_changes_the_order_of_the_contacts() -> None:
    throw = make_throw(4, 1.5)
    descent = descent_of(throw)
    times, random = straight(throw)[0], np.random.default_rng(0)
    for _ in range(50):
        moved = times + descent._limited(times, random.normal(scale=2, size=4))
        arcs = [np.diff(throw.knots(t)[0]) for t in (times, moved)]
        assert (arcs[1] >= SHORTEST * arcs[0] * (1 - 1e-12)).all()
        times = moved


# -- the run -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {"contacts": 0},
        {"contacts": 99},
        {"duration": 0.0},
        {"duration": 9.0},
        {"speed": float("nan")},
        {"steps": -1},
        {"floor": "x +"},
        {"floor": "y"},
    ],
    ids=str,
)
def test_throws_that_are_not_possible_are_input_errors(options: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        run_bouncing_ball(**options, out=tmp_path, **QUICK)
    assert error.value.hint


def test_an_interrupt_writes_what_there_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted_at_the_third(descent: ActionDescent) -> None:
        if len(descent.states) == 3:
            raise KeyboardInterrupt
        step(descent)

    step = ActionDescent.step
    monkeypatch.setattr(ActionDescent, "step", interrupted_at_the_third)
    report = run_bouncing_ball(contacts=2, out=tmp_path, **QUICK)
    assert report["interrupted"]
    assert (report["steps"], report["beside"]["steps"]) == (2, 0)
    assert (tmp_path / "bouncing_ball.png").exists()


def test_a_missing_package_and_a_folder_that_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        run_bouncing_ball(out=tmp_path / "file", **QUICK)
    monkeypatch.setitem(run.PACKAGES, "a_package_that_is_not_there", "thing")
    with pytest.raises(MissingPackageError, match="thing"):
        run_bouncing_ball(out=tmp_path, **QUICK)


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    quick = ["--contacts", "1", "--backend", "numpy", "--quiet", "-o", str(tmp_path)]
    assert main(["demo", "bouncing-ball", *quick]) == 0
    out = capsys.readouterr().out
    assert "exact: contacts off by" in out
    assert "half its speed" in out
    assert "bouncing_ball.png" in out
    assert main(["demo", "bouncing-ball", *quick, "--alone", "--discontinuities", "ignore"]) == 0
    assert "exact" not in capsys.readouterr().out
    assert main(["demo", "bouncing-ball", *quick, "--duration", "9"]) == 2
    assert "at most" in capsys.readouterr().err
