"""The text of `Locate` in plain Python, against which the backends are held to the bit."""

from __future__ import annotations

import math

from teg.program import (
    LOCATE_HALVINGS,
    LOCATE_MOST,
    LOCATE_NARROW,
    LOCATE_SAME,
    LOCATE_STEPS,
    LOCATE_WIDTH,
    LOCATE_ZEROS,
    Arg,
    Assign,
)
from tests.backends.locate_pairs import BOTTOM, LEFT, RIGHT, TOP, Pair
from tests.backends.programs import INF, NAN


def literally(pair: Pair, lo: float, hi: float, low: float, high: float, room: int, given: dict[Arg, float]) -> list[float]:
    """The text of `teg.program` in plain Python, for a pair whose block is assignments only; `given` are the parameters. The last entry is
    the part that was given up."""
    if not all(map(math.isfinite, (lo, hi, low, high))) or lo == hi or low == high:
        return [INF] * room + [0.0]
    (lo, hi), (low, high) = sorted((lo, hi)), sorted((low, high))
    extent, height = hi - lo, high - low
    corners, left, zeros, examined = [(0.0, 0.0)], [], [], 1
    times, last, shares = [0, 0], -1, [0.8, 0.8]
    while True:
        wide, tall = 2.0 ** -times[0], 2.0 ** -times[1]
        left = []
        for i, k in corners:
            box = (lo + extent * i, lo + extent * (i + wide), low + height * k, low + height * (k + tall))
            zero = _judged(pair, box, given)
            if zero is not None:
                zeros.append(zero)
            elif not _is_dropped(pair, box, given):
                left.append((i, k))
        if len(zeros) > LOCATE_ZEROS:
            return [INF] * room + [1.0]
        examined += 2 * len(left)
        if not left or min(times) == LOCATE_HALVINGS or 2 * len(left) > LOCATE_WIDTH or examined > LOCATE_MOST:
            break
        if last >= 0:
            shares[last] = len(left) / len(corners)
        last = 0 if times[0] <= times[1] else 1
        if max(shares) >= 0.98 and min(shares) <= 0.55:
            last = shares.index(min(shares))
        last = last if times[last] < LOCATE_HALVINGS else 1 - last
        times[last] += 1
        step = (2.0 ** -times[0], 0.0) if last == 0 else (0.0, 2.0 ** -times[1])
        corners = [(i + a, k + b) for i, k in left for a, b in ((0.0, 0.0), step)]
    rectangles = [(lo + extent * i, lo + extent * (i + wide)) for i, _ in left]
    intervals = [*rectangles]
    intervals += [(v - LOCATE_SAME * extent, v + LOCATE_SAME * extent) for v in zeros]
    joined: list[tuple[float, float]] = []
    for p, q in sorted(intervals):
        joined[-1:] = [*joined[-1:], (p, q)] if not joined or p > joined[-1][1] else [(joined[-1][0], max(q, joined[-1][1]))]
    places = [v for p, q in joined for v in ([p, q] if q - p > LOCATE_NARROW * extent else [0.5 * (p + q)])]
    broad = [(p, q) for p, q in joined if q - p > LOCATE_NARROW * extent]
    lost = sum(any(p <= left <= q for p, q in broad) for left, _ in rectangles) * (wide * tall)
    if len(places) > room:
        return [*places[:room], min(1.0, lost + max(0.0, (lo + extent - places[room - 1]) / extent))]
    return [*places, *[INF] * (room - len(places)), lost]


def _is_dropped(pair: Pair, box: tuple[float, float, float, float], given: dict[Arg, float]) -> bool:
    """Whether there is certainly no common zero in a rectangle."""
    bounds = _bounds(pair, dict(zip((LEFT, RIGHT, BOTTOM, TOP), box, strict=True)) | given)
    return _dropped(*bounds[:4]) or (len(bounds) > 4 and _krawczyk(pair, box, bounds, given) == "none")


def _judged(pair: Pair, box: tuple[float, float, float, float], given: dict[Arg, float]) -> float | None:
    """The v of the zero of a rectangle that is known to hold one."""
    bounds = _bounds(pair, dict(zip((LEFT, RIGHT, BOTTOM, TOP), box, strict=True)) | given)
    if _dropped(*bounds[:4]) or len(bounds) == 4 or _krawczyk(pair, box, bounds, given) != "one":
        return None
    v, u = 0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])
    for _ in range(LOCATE_STEPS):
        f, g, a, b, c, d = _bounds(pair, {LEFT: v, RIGHT: v, BOTTOM: u, TOP: u} | given)[::2]
        det = a * d - b * c
        v, u = v - (d * f - b * g) / det, u - (a * g - c * f) / det
    return v


def _krawczyk(pair: Pair, box: tuple[float, float, float, float], bounds: list[float], given: dict[Arg, float]) -> str:
    """The number of common zeros in a rectangle, as far as its slopes tell: "none", "one" or "any"."""
    v, u, h, k = 0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3]), 0.5 * (box[1] - box[0]), 0.5 * (box[3] - box[2])
    f, g = _bounds(pair, {LEFT: v, RIGHT: v, BOTTOM: u, TOP: u} | given)[:4:2]
    slopes = list(zip(bounds[4::2], bounds[5::2], strict=True))
    if any(math.isnan(s) for pair_ in slopes for s in pair_):
        return "any"
    sizes = [max(abs(p), abs(q)) for p, q in slopes]
    if abs(f) > sizes[0] * h + sizes[1] * k or abs(g) > sizes[2] * h + sizes[3] * k:
        return "none"
    a, b, c, d = (0.5 * (p + q) for p, q in slopes)
    ra, rb, rc, rd = (0.5 * (q - p) for p, q in slopes)
    det = abs(a * d - b * c)
    if det == 0.0 or math.isnan(det):
        return "any"
    a, b, c, d = a / det, b / det, c / det, d / det
    shift, rise = abs(d * f - b * g), abs(a * g - c * f)
    wide = (abs(d) * ra + abs(b) * rc) * h + (abs(d) * rb + abs(b) * rd) * k
    tall = (abs(c) * ra + abs(a) * rc) * h + (abs(c) * rb + abs(a) * rd) * k
    if shift > h + wide or rise > k + tall:
        return "none"
    return "one" if wide <= 0.25 * h and tall <= 0.25 * k and shift + wide < h and rise + tall < k else "any"


def _dropped(f0: float, f1: float, g0: float, g1: float) -> bool:
    undefined = (math.isnan(f0) and math.isnan(f1)) or (math.isnan(g0) and math.isnan(g1))
    return f0 > 0 or f1 < 0 or g0 > 0 or g1 < 0 or undefined


def _bounds(pair: Pair, values: dict[Arg, float]) -> list[float]:
    for stmt in pair.enclosure:
        assert isinstance(stmt, Assign)
        x, *rest = (values[arg] if isinstance(arg, str) else float(arg) for arg in stmt.args)
        values[stmt.name] = _operation(stmt.op, x, *rest)
    return [values[arg] if isinstance(arg, str) else float(arg) for arg in pair.bounds]


def _operation(op: str, x: float, y: float = 1.0, z: float = 1.0) -> float:
    match op:
        case "add":
            return x + y
        case "sub":
            return x - y
        case "mul":
            return x * y * z
        case "min" | "max":
            return NAN if x != x or y != y else min(x, y) if op == "min" else max(x, y)
        case "select":
            return y if x else z
        case "lt0":
            return float(x < 0)
        case "ge0":
            return float(x >= 0)
        case "sqrt":
            return math.sqrt(x) if x >= 0 else NAN
        case "sin":
            return math.sin(x)
        case "cos":
            return math.cos(x)
    raise ValueError(op)
