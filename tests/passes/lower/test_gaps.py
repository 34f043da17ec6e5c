"""Places along an edge where candidates begin and end to cover it, and how fast these move."""

import numpy as np
import pytest

import teg

x = teg.var("x")
t = teg.param("t")
V, W = teg.array("V"), teg.array("W")
k = teg.index("k")
u, w = x - V[k], W[k]
WORDS = {
    "abs": (abs(u) < 0.1 * w, (u < 0.1 * w) & (-u < 0.1 * w)),
    "maximum": (teg.maximum(u, -2 * u) < 0.1 * w, (u < 0.1 * w) & (-2 * u < 0.1 * w)),
    "where": (teg.where(u > 0, 2.0, 1.0) * abs(u) < 0.1 * w, (2 * u < 0.1 * w) & (-u < 0.1 * w)),
    "sign": (teg.sign(u) * u < 0.1 * w, (u < 0.1 * w) & (-u < 0.1 * w)),
}
"""An interval by a condition that bends inside of it, and as two half-lines."""


@pytest.mark.parametrize("name", WORDS)
def test_a_border_may_bend(name):
    """Its condition has conditions inside that are decided, or become several, after the velocities of borders are known."""
    at = {"V": [0.2, 0.5, 0.63], "W": [1.0, 2.0, 0.7], "t": 0.4}
    along = {"V": [1.0, -0.5, 0.3], "W": [0.4, 0.2, -1.0], "t": 0.5}
    products = []
    for inside in WORDS[name]:
        seen = teg.nearest(w, w * u**2, (k, 0, teg.length(V)), where=inside, otherwise=t * x)
        product = teg.compile(teg.integral(seen, (x, 0, 1)), [V, W, t]).hvp(at, along)
        products.append(np.concatenate([np.ravel(product[p]) for p in ("V", "W", "t")]))
    assert np.abs(products[1]).max() > 0.1
    np.testing.assert_allclose(products[0], products[1], rtol=1e-11, atol=1e-12)
