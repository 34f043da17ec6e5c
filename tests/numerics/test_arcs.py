"""Nodes on arcs: Gauss-Legendre on the longest arc integrates trigonometric polynomials to rounding."""

from __future__ import annotations

import math

import pytest

from teg.numerics.arcs import longest_arc, parts_of_a_circle
from teg.numerics.quadrature import gauss_legendre


@pytest.mark.parametrize("degree", [1, 2, 4, 8])
@pytest.mark.parametrize("nodes", [8, 12, 20])
def test_the_longest_arc_is_integrated_to_rounding(nodes: int, degree: int) -> None:
    arc = longest_arc(nodes, degree)
    assert arc > 0
    points, weights = gauss_legendre(nodes)
    found = 0.5 * arc * sum(w * math.cos(degree * 0.5 * arc * x) for x, w in zip(points, weights, strict=True))
    assert found == pytest.approx(2.0 * math.sin(0.5 * degree * arc) / degree, abs=4e-15 * max(1.0, arc))


def test_a_longer_arc_needs_more_nodes_and_a_circle_more_parts() -> None:
    assert longest_arc(8, 4) < longest_arc(16, 4)
    assert longest_arc(8, 8) < longest_arc(8, 4)
    assert parts_of_a_circle(8) >= parts_of_a_circle(2) >= 1
