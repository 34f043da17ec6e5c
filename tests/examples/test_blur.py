"""Motion blur and depth of field: pixels are those of an independent clipper, integrated over time or lens by brute force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main
from teg.examples.blur import lens, motion
from teg.examples.blur.run import MOVED, SEEN, Blur
from tests.examples.clipped_scenes import over_lens, over_time
from tests.examples.clipper import area, slope

SIZE = 6


@pytest.fixture(scope="module")
def moving() -> Blur:
    return Blur("motion-blur", SIZE, "c")


def test_the_value_of_a_motion() -> None:
    value = Blur("motion-blur", 3, "numpy").evaluator(T=np.zeros((3, 3)), **MOVED)
    expected = sum(over_time(3, MOVED, row, column, 300) ** 2 for row in range(3) for column in range(3))
    assert float(value) == pytest.approx(expected, abs=1e-4)


def test_the_value_through_a_lens() -> None:
    value = Blur("depth-of-field", 3, "numpy").evaluator(T=np.zeros((3, 3)), S=lens.slits(3), **SEEN)
    expected = sum(over_lens(3, SEEN, row, column, 100, slits=3) ** 2 for row in range(3) for column in range(3))
    assert float(value) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("demo", ["motion-blur", pytest.param("depth-of-field", marks=pytest.mark.thorough)])
def test_integrands_of_derivatives_are_smooth_between_their_breaks(demo: str) -> None:
    """Else an adaptive rule looks for what is not known, and takes several times as long."""
    boundary = Blur(demo, SIZE, "numpy").evaluator.explain().data["boundary"]
    assert boundary
    assert not [row for row in boundary if row["searched"]]


@pytest.mark.thorough
@pytest.mark.parametrize("still", [{}, {"spin": 0.0}, {"across": 0.0, "along": 0.0}, {"spin": 0.0, "across": 0.0, "along": 0.0}])
def test_a_moving_triangle(moving: Blur, still: dict[str, float]) -> None:
    numbers = MOVED | still
    expected = [[over_time(SIZE, numbers, row, column, 100) for column in range(SIZE)] for row in range(SIZE)]
    np.testing.assert_allclose(moving.picture(numbers), expected, atol=2e-4)


@pytest.mark.thorough
def test_a_moving_triangle_to_more_digits(moving: Blur) -> None:
    picture = moving.picture(MOVED)
    for row, column in ((2, 3), (3, 2)):
        assert 0.1 < picture[row, column] < 0.9
        coarse, fine = (over_time(SIZE, MOVED, row, column, count) for count in (1500, 3000))
        assert picture[row, column] == pytest.approx(fine, abs=1e-6)
        assert abs(fine - coarse) < 1e-6


@pytest.mark.thorough
def test_the_derivatives_by_the_motion(moving: Blur) -> None:
    row, column = 3, 2
    target = moving.picture(MOVED)
    target[row, column] -= 0.5  # the derivative of the loss is that of the pixel
    _, slopes = moving.loss_and_slopes(MOVED, target)
    for name in motion.MOTION:

        def pixel(s: float, name: str = name) -> float:
            return float(moving.picture({**MOVED, name: MOVED[name] + s})[row, column])

        assert float(slopes[name]) == pytest.approx(slope(pixel, 1e-3), rel=1e-4, abs=1e-5)
        apart = [over_time(SIZE, {**MOVED, name: MOVED[name] + s}, row, column, 1000) for s in (0.01, -0.01)]
        assert float(slopes[name]) == pytest.approx((apart[0] - apart[1]) / 0.02, rel=2e-2, abs=5e-3)


@pytest.mark.thorough
def test_a_moved_triangle_has_moved_by_as_much(moving: Blur) -> None:
    """Exactly: the exposure of the whole screen is the area, whatever the motion, and its centre is two thirds of the way along it."""
    numbers = MOVED | {"spin": 0.0, "right": -0.4, "across": 0.3}
    picture = moving.picture(numbers) * (2 / SIZE) ** 2
    corners = np.array(motion.CORNERS)
    whole = area([[(float(p), float(q)) for p, q in corners]])
    assert picture.sum() == pytest.approx(whole, abs=1e-12)
    _, slopes = moving.loss_and_slopes(numbers, moving.picture(numbers) - 0.5)
    assert [float(slopes[name]) for name in ("right", "across", "along")] == pytest.approx([0.0] * 3, abs=1e-10)


@pytest.fixture(scope="module")
def focused() -> Blur:
    return Blur("depth-of-field", SIZE, "c")


@pytest.mark.thorough
def test_a_slanted_triangle(focused: Blur) -> None:
    picture = focused.picture(SEEN)
    expected = [[over_lens(SIZE, SEEN, row, column, 60) for column in range(SIZE)] for row in range(SIZE)]
    np.testing.assert_allclose(picture, expected, atol=2e-4)
    row, column = np.unravel_index(np.argmin(abs(picture - 0.5)), picture.shape)
    target = picture.copy()
    target[row, column] -= 0.5
    _, slopes = focused.loss_and_slopes(SEEN, target)
    for name in lens.LENS:

        def pixel(s: float, name: str = name) -> float:
            return float(focused.picture({**SEEN, name: SEEN[name] + s})[row, column])

        assert float(slopes[name]) == pytest.approx(slope(pixel, 1e-3), rel=1e-5, abs=1e-7)
        apart = [over_lens(SIZE, {**SEEN, name: SEEN[name] + s}, int(row), int(column), 300) for s in (0.01, -0.01)]
        assert float(slopes[name]) == pytest.approx((apart[0] - apart[1]) / 0.02, rel=1e-2, abs=1e-3)


def test_slits_are_a_round_lens() -> None:
    for count in (6, 12):
        v, half, weight = lens.slits(count).T
        assert (2 * half * weight).sum() == pytest.approx(1, abs=1e-14)
        assert (2 * half * weight * v**2).sum() == pytest.approx(0.25, abs=1e-14)  # of a disk
        assert (2 * half**3 / 3 * weight).sum() == pytest.approx(0.25, abs=1e-14)


@pytest.mark.thorough
@pytest.mark.parametrize("demo", ["motion-blur", "depth-of-field"])
def test_demo(demo: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", demo, "--size", "8", "-o", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name, number in (MOVED if demo == "motion-blur" else SEEN).items():
        (line,) = [text for text in lines if text.startswith(f"{name} ")]
        assert float(line.split("->")[1].split()[0]) == pytest.approx(number, abs=1e-5)
    assert (tmp_path / "blur.png").stat().st_size > 5000
