"""Families of functions g, each written once as the two blocks of an `Isolate`, with the bounds of interval arithmetic."""

from __future__ import annotations

from dataclasses import dataclass

from teg.program import Arg, Isolate, Stmt, SumOver
from tests.backends.programs import NAN, let


@dataclass(frozen=True)
class Surface:
    """g of the variable x0, and its bounds between x0l and x0r."""

    enclosure: tuple[Stmt, ...]
    bounds: tuple[Arg, Arg, Arg, Arg]
    point: tuple[Stmt, ...]
    value: Arg
    slope: Arg


def isolate(results: str, g: Surface, lo: Arg, hi: Arg, when: str | None = None) -> Isolate:
    """The roots of g; the names of the results are written in one string."""
    return Isolate("x0", lo, hi, "x0l", "x0r", g.enclosure, g.bounds, g.point, g.value, g.slope, tuple(results.split()), when)


def sum_over(results: str, var: str, points: tuple[Arg, ...], body: tuple[Stmt, ...], *values: Arg, when: str | None = None) -> SumOver:
    return SumOver(var, points, body, values, tuple(results.split()), when)


def numbered(count: int, letter: str = "r") -> str:
    """Names of so many results."""
    return " ".join(f"v{letter}{i}" for i in range(count))


def cubic(p: Arg) -> Surface:
    """x³ - p·x."""
    return Surface(
        (
            let("vll3", "powi", "x0l", 3),
            let("vrr3", "powi", "x0r", 3),
            let("vpl", "mul", p, "x0l"),
            let("vpr", "mul", p, "x0r"),
            let("vmin", "min", "vpl", "vpr"),
            let("vmax", "max", "vpl", "vpr"),
            let("vlow", "sub", "vll3", "vmax"),
            let("vhigh", "sub", "vrr3", "vmin"),
            let("vll2", "powi", "x0l", 2),
            let("vrr2", "powi", "x0r", 2),
            let("vlr", "mul", "x0l", "x0r"),
            let("bin", "lt0", "vlr"),
            let("vmin2", "min", "vll2", "vrr2"),
            let("vmax2", "max", "vll2", "vrr2"),
            let("v02", "select", "bin", 0.0, "vmin2"),
            let("v3low", "mul", 3.0, "v02"),
            let("v3high", "mul", 3.0, "vmax2"),
            let("vdlow", "sub", "v3low", p),
            let("vdhigh", "sub", "v3high", p),
        ),
        ("vlow", "vhigh", "vdlow", "vdhigh"),
        (
            let("v3", "powi", "x0", 3),
            let("vpx", "mul", p, "x0"),
            let("vg", "sub", "v3", "vpx"),
            let("v2", "powi", "x0", 2),
            let("v23", "mul", 3.0, "v2"),
            let("vd", "sub", "v23", p),
        ),
        "vg",
        "vd",
    )


def wave(k: Arg, c: Arg = 0.0) -> Surface:
    """sin(k·x) - c for k >= 0, bounded by its value and slope in the middle and Taylor's theorem."""
    return Surface(
        (
            let("vends", "add", "x0l", "x0r"),
            let("vwide", "sub", "x0r", "x0l"),
            let("vkm", "mul", 0.5, "vends", k),
            let("vkh", "mul", 0.5, "vwide", k),
            let("vsin", "sin", "vkm"),
            let("vcos", "cos", "vkm"),
            let("vs0", "sub", "vsin", "vkh"),
            let("vs1", "add", "vsin", "vkh"),
            let("vs2", "max", "vs0", -1.0),
            let("vs3", "min", "vs1", 1.0),
            let("vlow", "sub", "vs2", c),
            let("vhigh", "sub", "vs3", c),
            let("vc0", "sub", "vcos", "vkh"),
            let("vc1", "add", "vcos", "vkh"),
            let("vdlow", "mul", k, "vc0"),
            let("vdhigh", "mul", k, "vc1"),
        ),
        ("vlow", "vhigh", "vdlow", "vdhigh"),
        (
            let("vkx", "mul", k, "x0"),
            let("vsx", "sin", "vkx"),
            let("vg", "sub", "vsx", c),
            let("vcx", "cos", "vkx"),
            let("vd", "mul", k, "vcx"),
        ),
        "vg",
        "vd",
    )


def square(p: Arg, c: Arg = 0.0) -> Surface:
    """(x - p)² - c."""
    return Surface(
        (
            let("va", "sub", "x0l", p),
            let("vb", "sub", "x0r", p),
            let("va2", "powi", "va", 2),
            let("vb2", "powi", "vb", 2),
            let("vab", "mul", "va", "vb"),
            let("bin", "lt0", "vab"),
            let("vmin2", "min", "va2", "vb2"),
            let("vmax2", "max", "va2", "vb2"),
            let("v02", "select", "bin", 0.0, "vmin2"),
            let("vlow", "sub", "v02", c),
            let("vhigh", "sub", "vmax2", c),
            let("vdlow", "mul", 2.0, "va"),
            let("vdhigh", "mul", 2.0, "vb"),
        ),
        ("vlow", "vhigh", "vdlow", "vdhigh"),
        (
            let("vx", "sub", "x0", p),
            let("vx2", "powi", "vx", 2),
            let("vg", "sub", "vx2", c),
            let("vd", "mul", 2.0, "vx"),
        ),
        "vg",
        "vd",
    )


def line(s: Arg, p: Arg) -> Surface:
    """s·(x - p)."""
    return Surface(
        (
            let("va", "sub", "x0l", p),
            let("vb", "sub", "x0r", p),
            let("vsa", "mul", s, "va"),
            let("vsb", "mul", s, "vb"),
            let("vlow", "min", "vsa", "vsb"),
            let("vhigh", "max", "vsa", "vsb"),
        ),
        ("vlow", "vhigh", s, s),
        (let("vx", "sub", "x0", p), let("vg", "mul", s, "vx")),
        "vg",
        s,
    )


def kink(p: Arg, c: Arg = 0.0) -> Surface:
    """|x - p| - c."""
    return Surface(
        (
            let("va", "sub", "x0l", p),
            let("vb", "sub", "x0r", p),
            let("vaa", "abs", "va"),
            let("vbb", "abs", "vb"),
            let("vab", "mul", "va", "vb"),
            let("bin", "le0", "vab"),
            let("vmin", "min", "vaa", "vbb"),
            let("vmax", "max", "vaa", "vbb"),
            let("v0", "select", "bin", 0.0, "vmin"),
            let("vlow", "sub", "v0", c),
            let("vhigh", "sub", "vmax", c),
            let("bright", "gt0", "va"),
            let("bleft", "lt0", "vb"),
            let("vdlow", "select", "bright", 1.0, -1.0),
            let("vdhigh", "select", "bleft", -1.0, 1.0),
        ),
        ("vlow", "vhigh", "vdlow", "vdhigh"),
        (
            let("vx", "sub", "x0", p),
            let("vxx", "abs", "vx"),
            let("vg", "sub", "vxx", c),
            let("bx", "gt0", "vx"),
            let("vd", "select", "bx", 1.0, -1.0),
        ),
        "vg",
        "vd",
    )


def ramps(p: Arg) -> Surface:
    """max(0, x) - 2·max(0, x - p), 0 for x <= 0; nothing is known of its slope."""
    return Surface(
        (
            let("val", "max", 0.0, "x0l"),
            let("var", "max", 0.0, "x0r"),
            let("vl", "sub", "x0l", p),
            let("vr", "sub", "x0r", p),
            let("vbl", "max", 0.0, "vl"),
            let("vbr", "max", 0.0, "vr"),
            let("vbl2", "mul", 2.0, "vbl"),
            let("vbr2", "mul", 2.0, "vbr"),
            let("vlow", "sub", "val", "vbr2"),
            let("vhigh", "sub", "var", "vbl2"),
        ),
        ("vlow", "vhigh", NAN, NAN),
        (
            let("va", "max", 0.0, "x0"),
            let("vx", "sub", "x0", p),
            let("vb", "max", 0.0, "vx"),
            let("vb2", "mul", 2.0, "vb"),
            let("vg", "sub", "va", "vb2"),
        ),
        "vg",
        NAN,
    )


def root(p: Arg, strict: bool = False) -> Surface:
    """√x - p, NaN for x < 0; `strict` bounds are NaN if any x is negative."""
    mean = (let("vlow", "min", "va", "vb"), let("vhigh", "max", "va", "vb")) if strict else ()
    return Surface(
        (
            let("vsl", "sqrt", "x0l"),
            let("vsr", "sqrt", "x0r"),
            let("va", "sub", "vsl", p),
            let("vb", "sub", "vsr", p),
            *mean,
            let("vdlow", "div", 0.5, "vsr"),
            let("vdhigh", "div", 0.5, "vsl"),
        ),
        ("vlow", "vhigh", "vdlow", "vdhigh") if strict else ("va", "vb", "vdlow", "vdhigh"),
        (let("vs", "sqrt", "x0"), let("vg", "sub", "vs", p), let("vd", "div", 0.5, "vs")),
        "vg",
        "vd",
    )


def difference_of_cubes(y: Arg) -> Surface:
    """x³ - y³ for x >= 0."""
    return Surface(
        (
            let("vll3", "powi", "x0l", 3),
            let("vrr3", "powi", "x0r", 3),
            let("vy3", "powi", y, 3),
            let("vlow", "sub", "vll3", "vy3"),
            let("vhigh", "sub", "vrr3", "vy3"),
            let("vll2", "powi", "x0l", 2),
            let("vrr2", "powi", "x0r", 2),
            let("vdlow", "mul", 3.0, "vll2"),
            let("vdhigh", "mul", 3.0, "vrr2"),
        ),
        ("vlow", "vhigh", "vdlow", "vdhigh"),
        (
            let("v3", "powi", "x0", 3),
            let("vyy3", "powi", y, 3),
            let("vg", "sub", "v3", "vyy3"),
            let("v2", "powi", "x0", 2),
            let("vd", "mul", 3.0, "v2"),
        ),
        "vg",
        "vd",
    )


NOWHERE_ZERO = Surface((), (1.0, 2.0, -1.0, 1.0), (), 1.5, 0.0)
ZERO = Surface((), (0.0, 0.0, 0.0, 0.0), (), 0.0, 0.0)
UNDEFINED = Surface((), (NAN, NAN, NAN, NAN), (), NAN, NAN)
