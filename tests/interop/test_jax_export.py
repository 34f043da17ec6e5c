"""Programs of XLA lowered for a GPU, without one: what stands in the graph. None of them is run."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import Any

import numpy as np
import pytest

import teg

jax = pytest.importorskip("jax")
export = pytest.importorskip("jax.export")

x, y = teg.vars("x y")
t, a = teg.params("t a")
CORNERS = teg.params("ax ay bx by cx cy")


def triangle() -> Any:
    """A pixel of a triangle with a linear colour."""
    ax, ay, bx, by, cx, cy = CORNERS
    sides = ((ax, ay, bx, by), (bx, by, cx, cy), (cx, cy, ax, ay))
    inside = [teg.bracket((qx - px) * (y - py) - (qy - py) * (x - px) > 0) for px, py, qx, qy in sides]
    return teg.integral(inside[0] * inside[1] * inside[2] * (1 + x + 2 * y), (x, 0, 1), (y, 0, 1))


def operations(e: Any, at: dict[str, float], dtype: Any = np.float32) -> Counter[str]:
    """How often each operation stands in the program of the value and gradient of a batch, and each custom call, lowered for CUDA."""
    f = teg.jax_function(e)
    batch = {k: np.full(8, v, dtype) for k, v in at.items()}
    exported = export.export(jax.jit(jax.value_and_grad(lambda p: f(p).sum())), platforms=["cuda"])(batch)
    assert exported.platforms == ("cuda",)
    text = exported.mlir_module()
    return Counter([*re.findall(r"stablehlo\.(\w+)", text), *re.findall(r"custom_call @(\w+)", text)])


def stays_on_the_device(found: Counter[str]) -> bool:
    """Whether nothing is called on the host: there are no custom calls, which callbacks and compiled kernels are."""
    return sum(found.values()) > 100 and not any(found[k] for k in ("custom_call", "infeed", "outfeed", "send", "recv"))


def test_pixels_of_triangles_are_gathered_only_where_their_straight_line_does_not_hold() -> None:
    found = operations(triangle(), {"ax": 0.2, "ay": 0.1, "bx": 1.4, "by": 0.4, "cx": 0.3, "cy": 0.8})
    assert stays_on_the_device(found)
    assert found["case"] == 1  # whether there are such pixels
    assert found["sort"] == 1
    assert found["gather"] == 2 * 6  # inputs (each operation is named twice)
    assert found["scatter"] == 2 * 8  # value, gradient and note
    assert found["while"] == 2  # parts of them, both orders of a tie


CASES = {
    "a disk": (teg.integral(teg.bracket(x * x + y * y < t * t), (x, -1, 1), (y, -1, 1)), {"t": 0.6}),
    "exp in a disk": (teg.integral(teg.bracket(x * x + y * y < t * t) * teg.exp(x), (x, -1, 1), (y, -1, 1)), {"t": 0.6}),
    "probit": (teg.integral(teg.bracket(a * x < t) * teg.exp(-x * x / 2), (x, -math.inf, math.inf)), {"t": 0.3, "a": 1.2}),
    "an adaptive half-plane": (teg.integral(teg.bracket(x + a * y < t) * teg.exp(x), (x, 0, 1), (y, 0, 1)), {"t": 0.3, "a": 1.2}),
}


@pytest.mark.parametrize("name", CASES)
def test_breaks_are_sorted_and_nothing_is_gathered(name: str) -> None:
    found = operations(*CASES[name])
    assert stays_on_the_device(found)
    assert found["gather"] == found["scatter"] == 0
    is_straight = name in ("a disk", "probit")  # moments of an ellipse, a closed form on one interval: no breaks
    assert (found["sort"] == 0) == is_straight
    assert found["sort"] <= 4
    assert name != "a disk" or found["while"] <= 1  # both orders of a tie


def test_a_picture_gathers_its_vertices_and_scatters_their_derivatives() -> None:
    """A sum over pairs of a triangle and a pixel: each entry of an array is one gather, and the derivative by it one scatter; and so
    is each input and result of pairs whose straight line does not hold."""
    from teg.examples.triangulation.sharded import loss_by_pairs

    f = teg.jax_function(loss_by_pairs())
    values = {
        "vertices": np.array([[0.1, 0.1], [3.2, 0.4], [0.8, 2.9], [3.0, 3.1]], np.float32),
        "colours": np.full((2, 3), 0.5, np.float32),
        "target": np.zeros((4, 4, 3), np.float32),
    }
    indices = {"faces": np.array([[0, 1, 2], [1, 3, 2]]), "pairs": np.array([[0, 1, 1], [1, 2, 2], [0, 0, 0]])}
    exported = export.export(jax.jit(jax.grad(lambda p: f({**p, **indices}))), platforms=["cuda"])(values)
    found = Counter([*re.findall(r"stablehlo\.(\w+)", exported.mlir_module())])
    assert found["custom_call"] == 0
    assert 0 < found["gather"] <= 36 + 2 * 14
    assert 0 < found["scatter"] <= 24 + 2 * 14
    assert found["sort"] == found["case"] == 1  # of pairs whose straight line does not hold


def test_derivatives_of_a_picture_are_summed_over_the_pixels_of_a_face_before_they_are_scattered() -> None:
    """A sum over faces and their windows: entries of the vertices and the colours get one number a face, whatever the window is."""
    from teg.examples.triangulation.sharded import loss_by_faces

    faces, width, height = 5, 4, 3
    loss = loss_by_faces()
    f = teg.jax_function(loss, [teg.array("vertices", 2), teg.array("colours", 2)])
    values = {"vertices": np.zeros((7, 2), np.float32), "colours": np.full((faces, 3), 0.5, np.float32)}
    still = {"target": np.zeros((6, 6, 3), np.float32), "faces": np.arange(3 * faces).reshape(faces, 3) % 7}
    still |= {"corners": np.zeros((faces, 2), int), "width": width, "height": height}
    exported = export.export(jax.jit(jax.grad(lambda p: f({**p, **still}))), platforms=["cuda"])(values)
    text = exported.mlir_module()
    assert not re.search(r"stablehlo\.(custom_call|infeed|outfeed|send|recv)", text)
    assert text.count('"stablehlo.sort"') == text.count('"stablehlo.case"') == 1  # of pixels whose straight line does not hold
    scatters = re.findall(r"\}\)[^\n]*: \(tensor<(\d+x\S+)xf64>, tensor<\S+xi32>, tensor<(\d+)(\S*)xf64>\) -> ", text)
    assert Counter((into, int(rows)) for into, rows, _ in scatters if into in ("7x2", f"{faces}x3")) == {
        ("7x2", faces): 6,  # the coordinates of three corners
        (f"{faces}x3", faces): 3,
    }
    assert all(into in ("7x2", f"{faces}x3") for into, _, _ in scatters)  # sums of pixels and rows are sums of the rows of matrices
    matrices = re.findall(r"stablehlo.reduce\(.*applies stablehlo.add across dimensions = \[1\] : \(tensor<(\d+x\d+)xf64>", text)
    assert {f"{faces * height}x{width}", f"{faces}x{height}"} <= set(matrices)
