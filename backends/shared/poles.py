"""Weights of Gauss nodes for rational integrands with one pole, by NumPy or JAX: `Rational` of `teg.program`."""

from __future__ import annotations

from typing import Any

from teg.numerics.quadrature import gauss_legendre, pole_table


def pole_weights(xp: Any, nodes: int, power: int, low: Any, high: Any) -> Any:
    """The weights for polynomials over a power of a function that goes from low to high, (nodes, …) for low and high of shape (…).

    `xp` is numpy or jax.numpy. Moments of 1/(1 + zu)^m: downwards from a series for small z, upwards from a logarithm else.
    """
    table, at = pole_table(nodes, power), gauss_legendre(nodes)[0]
    z = (high - low) / (high + low)
    square, near = z * z, xp.abs(z) < table.border
    moments: list[Any] = [2.0 / (j + 1) if j % 2 == 0 else 0.0 for j in range(nodes)]
    for level in range(1, power + 1):
        top = xp.zeros_like(z)
        for c in reversed(table.series[level - 1]):
            top = top * square + c
        down: list[Any] = [-z * top if nodes % 2 == 0 else top]
        for before in reversed(moments[:-1]):
            down.insert(0, before - z * down[0])
        k = level - 1
        first = xp.log(high / low) if k == 0 else ((0.5 * (high + low) / low) ** k - (0.5 * (high + low) / high) ** k) / k
        up: list[Any] = [first / z]
        for before in moments[:-1]:
            up.append((before - up[-1]) / z)
        moments = [xp.where(near, d, u) for d, u in zip(down, up, strict=True)]
    rows = [sum(c * m for c, m in zip(row, moments, strict=True)) for row in table.lagrange]
    return xp.stack([row * (1.0 + z * u) ** power for row, u in zip(rows, at, strict=True)])
