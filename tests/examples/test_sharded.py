"""The loss of a whole picture shared out between eight devices, by pairs and by triangles, against the C backend on one thread."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("jax")

from teg.errors import InputError
from teg.examples.triangulation.image_loss import bounding_boxes
from teg.examples.triangulation.mesh import make_mesh
from teg.examples.triangulation.run import run_triangulation
from teg.examples.triangulation.sharded import ShardedLoss, shared_pairs, windows

EIGHT = """
import sys
import jax, numpy as np
from teg.examples.triangulation.image_loss import ImageLoss
from teg.examples.triangulation.mesh import make_mesh
from teg.examples.triangulation.scene import compile_scene
from teg.examples.triangulation.sharded import ShardedLoss

assert jax.device_count() == 8
by = sys.argv[1]
mesh, random = make_mesh(23, 12, seed=1), np.random.default_rng(0)
target, colours = random.uniform(size=(12, 12, 3)), random.uniform(size=(len(mesh.triangles), 3))
exact = ImageLoss(compile_scene("numpy"), target, mesh.triangles)
values = exact._values(mesh.vertices, colours)
loss = ShardedLoss(by, target, mesh.triangles)
value, (slopes, of_colours) = loss.value_and_grad(mesh.vertices, colours)
np.testing.assert_allclose(value, exact.scene.by_vertices(values), rtol=1e-14)
np.testing.assert_allclose(of_colours, exact.scene.by_colours.grad(values)["colours"], rtol=1e-13, atol=1e-16)
np.testing.assert_allclose(slopes, exact.gradient(mesh.vertices, colours), rtol=1e-12, atol=1e-15)
np.testing.assert_allclose(loss.gradient(mesh.vertices, colours), slopes, rtol=1e-12, atol=1e-15)
least, best = exact.best_colours(mesh.vertices, colours)
found, chosen = loss.best_colours(mesh.vertices, colours)
np.testing.assert_allclose(found, least, rtol=1e-12)
np.testing.assert_allclose(chosen, best, rtol=1e-11)
"""


@pytest.mark.slow
@pytest.mark.parametrize("by", ["pairs", "faces"])
def test_eight_devices_give_what_numpy_gives(by: str) -> None:
    flags = {"XLA_FLAGS": "--xla_force_host_platform_device_count=8", "JAX_PLATFORMS": "cpu"}
    subprocess.run([sys.executable, "-c", EIGHT, by], check=True, env=os.environ | flags)


@pytest.mark.slow
def test_a_descent_on_shares_is_the_same(tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    Image = pytest.importorskip("PIL.Image")
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (16, 16, 3), dtype=np.uint8)).save(tmp_path / "noise.png")
    small: dict[str, Any] = {"photo": tmp_path / "noise.png", "size": 16, "triangles": 6, "steps": 2, "progress": False}
    shared = run_triangulation(**small, out=tmp_path / "shared", shared_by="pairs")
    alone = run_triangulation(**small, out=tmp_path / "alone", backend="numpy")
    np.testing.assert_allclose(shared["losses"], alone["losses"], rtol=1e-11)
    assert "--shared-by pairs" in shared["command"]
    with pytest.raises(InputError, match="devices"):
        run_triangulation(**small, out=tmp_path / "no", backend="c", shared_by="pairs")


def test_pairs_and_windows_hold_all_that_a_triangle_may_touch() -> None:
    mesh = make_mesh(23, 12, seed=1)
    boxes = bounding_boxes(mesh.vertices[mesh.triangles], 12)
    wanted = {(f, c, r) for f, (a, b, top, end) in enumerate(boxes.tolist()) for c in range(a, b) for r in range(top, end)}
    count = len(wanted)
    for devices in (1, 5, 8):
        pairs = shared_pairs(boxes, devices)
        assert {tuple(p) for p in pairs[:count].tolist()} == wanted
        assert len({tuple(p) for p in pairs[count:].tolist()} - wanted) == 1  # a pixel, and a triangle that is elsewhere
        assert pairs[count:].tolist() == [[np.argmax(boxes[:, 0] + boxes[:, 2] > 0), 0, 0]] * (len(pairs) - count)
        assert len(pairs) % devices == 0
        assert len(pairs) <= 1.25 * count
    everywhere = np.array([[0, 3, 0, 3], [0, 2, 0, 5]])
    assert shared_pairs(everywhere, 4)[19:].tolist() == [[2, 0, 0]]  # the triangle behind the last one
    corners, (width, height) = windows(boxes, 12, 25)
    assert corners.shape == (25, 2)
    looked_at = {(f, c + i, r + j) for f, (c, r) in enumerate(corners.tolist()) for i in range(width) for j in range(height)}
    assert wanted <= looked_at
    assert all(0 <= c < 12 and 0 <= r < 12 for _, c, r in looked_at)


def test_what_cannot_be_shared_out() -> None:
    target, triangles = np.zeros((8, 8, 3)), np.array([[0, 1, 2]])
    with pytest.raises(InputError, match="rows"):
        ShardedLoss("rows", target, triangles)
    with pytest.raises(InputError, match="no device"):
        ShardedLoss("pairs", target, triangles, [])
