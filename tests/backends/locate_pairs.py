"""Pairs of functions f, g of (v, u) whose common zeros a `Locate` finds.

Each is written once, as the block that bounds them by interval arithmetic, and their slopes if it is `sloped`.
"""

from __future__ import annotations

from dataclasses import dataclass

from teg.program import Arg, Assign, Locate, Stmt
from tests.backends.programs import let

LEFT, RIGHT, BOTTOM, TOP = "x0l", "x0r", "x1l", "x1r"


@dataclass(frozen=True)
class Pair:
    """Bounds of f and g for v between x0l and x0r and u between x1l and x1r; maybe of their slopes by v and by u."""

    enclosure: tuple[Stmt, ...]
    bounds: tuple[Arg, ...]


def locate(results: str, pair: Pair, lo: Arg, hi: Arg, low: Arg, high: Arg, when: str | None = None, lost: str | None = None) -> Locate:
    """The places of a pair; the names of the results are written in one string."""
    return Locate(lo, hi, low, high, LEFT, RIGHT, BOTTOM, TOP, pair.enclosure, pair.bounds, tuple(results.split()), when, lost)


def sloped(pair: Pair, block: tuple[Stmt, ...], *slopes: Arg) -> Pair:
    """A pair with bounds of ∂f/∂v, ∂f/∂u, ∂g/∂v, ∂g/∂u, which the block computes."""
    return Pair((*pair.enclosure, *block), (*pair.bounds, *slopes))


def doubled(name: str) -> tuple[Assign, ...]:
    """Bounds of the slopes of a circle of that name: v‹name›0v, v‹name›1v by v, v‹name›0u, v‹name›1u by u."""
    ends = ((i, side, end) for side in "vu" for i, end in enumerate("ab"))
    return tuple(let(f"v{name}{i}{side}", "mul", 2.0, f"v{name}{side}{end}") for i, side, end in ends)


def distance(name: str, low: Arg, high: Arg, p: Arg) -> tuple[Assign, ...]:
    """Bounds v‹name›low, v‹name›high of (x - p)² for x between low and high."""
    return (
        let(f"v{name}a", "sub", low, p),
        let(f"v{name}b", "sub", high, p),
        let(f"v{name}aa", "mul", f"v{name}a", f"v{name}a"),
        let(f"v{name}bb", "mul", f"v{name}b", f"v{name}b"),
        let(f"v{name}ab", "mul", f"v{name}a", f"v{name}b"),
        let(f"b{name}", "lt0", f"v{name}ab"),
        let(f"v{name}min", "min", f"v{name}aa", f"v{name}bb"),
        let(f"v{name}low", "select", f"b{name}", 0.0, f"v{name}min"),
        let(f"v{name}high", "max", f"v{name}aa", f"v{name}bb"),
    )


def circle(name: str, v: Arg, u: Arg, p: Arg) -> tuple[Assign, ...]:
    """Bounds v‹name›0, v‹name›1 of the squared distance from (v, u), less p."""
    return (
        *distance(f"{name}v", LEFT, RIGHT, v),
        *distance(f"{name}u", BOTTOM, TOP, u),
        let(f"v{name}s0", "add", f"v{name}vlow", f"v{name}ulow"),
        let(f"v{name}s1", "add", f"v{name}vhigh", f"v{name}uhigh"),
        let(f"v{name}0", "sub", f"v{name}s0", p),
        let(f"v{name}1", "sub", f"v{name}s1", p),
    )


def ends(v: Arg, u: Arg, p: Arg) -> Pair:
    """A circle and 2(u - its centre), its derivative by u: zero where v is an end of the circle."""
    slope = (let("vda", "mul", 2.0, "vfua"), let("vdb", "mul", 2.0, "vfub"))
    return Pair((*circle("f", v, u, p), *slope), ("vf0", "vf1", "vda", "vdb"))


def two_circles(v: Arg, u: Arg, p: Arg, q: Arg) -> Pair:
    """v² + u² - p, and a circle of squared radius q about (v, u)."""
    return Pair((*circle("f", 0.0, 0.0, p), *circle("g", v, u, q)), ("vf0", "vf1", "vg0", "vg1"))


def point(v: Arg, u: Arg) -> Pair:
    """v less a number, and u less another."""
    body = (let("va", "sub", LEFT, v), let("vb", "sub", RIGHT, v), let("vc", "sub", BOTTOM, u), let("vd", "sub", TOP, u))
    return Pair(body, ("va", "vb", "vc", "vd"))


def chord(v: Arg, p: Arg) -> Pair:
    """v² + u² - p, and v less a number."""
    return Pair((*circle("f", 0.0, 0.0, p), let("va", "sub", LEFT, v), let("vb", "sub", RIGHT, v)), ("vf0", "vf1", "va", "vb"))


def wave(k: Arg, u: Arg) -> Pair:
    """sin(k·v) for k >= 0, bounded by its value in the middle; and u less a number."""
    body = (
        let("vends", "add", LEFT, RIGHT),
        let("vwide", "sub", RIGHT, LEFT),
        let("vkm", "mul", 0.5, "vends", k),
        let("vkh", "mul", 0.5, "vwide", k),
        let("vsin", "sin", "vkm"),
        let("vlow", "sub", "vsin", "vkh"),
        let("vhigh", "add", "vsin", "vkh"),
        let("vc", "sub", BOTTOM, u),
        let("vd", "sub", TOP, u),
    )
    return Pair(body, ("vlow", "vhigh", "vc", "vd"))


def corner(v: Arg, u: Arg) -> Pair:
    """f is 0 for v below a number, else 1; g is 0 for u below another, else 1."""
    body = (
        let("va", "sub", LEFT, v),
        let("ba", "ge0", "va"),
        let("vlow", "select", "ba", 1.0, 0.0),
        let("vb", "sub", BOTTOM, u),
        let("bb", "ge0", "vb"),
        let("vlow2", "select", "bb", 1.0, 0.0),
    )
    return Pair(body, ("vlow", 1.0, "vlow2", 1.0))


def root(p: Arg, u: Arg) -> Pair:
    """√v - p, whose lower bound is NaN where v < 0 is met, its upper one where v > 0 is not; and u less a number."""
    body = (
        let("vsl", "sqrt", LEFT),
        let("vsr", "sqrt", RIGHT),
        let("va", "sub", "vsl", p),
        let("vb", "sub", "vsr", p),
        let("vc", "sub", BOTTOM, u),
        let("vd", "sub", TOP, u),
    )
    return Pair(body, ("va", "vb", "vc", "vd"))


def sloped_ends(v: Arg, u: Arg, p: Arg) -> Pair:
    """`ends` with slopes: those of 2(u - centre) are 0 and 2."""
    return sloped(ends(v, u, p), doubled("f"), "vf0v", "vf1v", "vf0u", "vf1u", 0.0, 0.0, 2.0, 2.0)


def sloped_circles(v: Arg, u: Arg, p: Arg, q: Arg) -> Pair:
    """`two_circles` with slopes."""
    names = [f"v{c}{i}{side}" for c in "fg" for side in "vu" for i in (0, 1)]
    return sloped(two_circles(v, u, p, q), (*doubled("f"), *doubled("g")), *names)


def sloped_wave(k: Arg, u: Arg) -> Pair:
    """`wave` with slopes: that of sin(k·v) is bounded by its value in the middle."""
    block = (
        let("vcos", "cos", "vkm"),
        let("vs", "mul", k, "vcos"),
        let("vsh", "mul", k, "vkh"),
        let("vs0", "sub", "vs", "vsh"),
        let("vs1", "add", "vs", "vsh"),
    )
    return sloped(wave(k, u), block, "vs0", "vs1", 0.0, 0.0, 0.0, 0.0, 1.0, 1.0)


def exchanged(pair: Pair) -> Pair:
    """g, f for f, g."""
    return Pair(pair.enclosure, (*pair.bounds[2:], *pair.bounds[:2]))
