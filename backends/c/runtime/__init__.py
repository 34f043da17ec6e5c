"""What a kernel needs of the headers beside this file: their units and numbered constants, no more of them than are used."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from teg.backends.c.chunks import MARKED
from teg.backends.c.text import identifiers
from teg.numerics.cells import (
    BESIDE,
    EPSILON,
    LIMIT,
    MOST_DEGREE,
    MOST_GUARDS,
    NUDGE,
    PARTED,
    PARTING,
    PLACES,
    SAME,
    SHIFT,
    SKEW,
    SLOW,
    TILE_AT,
    monomials,
)
from teg.numerics.cells import ROUNDING as KEY_ROUNDING
from teg.numerics.polyhedra import SIDES, box_edges
from teg.program import (
    AT_END,
    AT_REACH,
    BEYOND,
    BOX_COST,
    CANCELLED,
    CANCELS,
    CLIP_EPS,
    CLOSE_ENDS,
    DEEP,
    DIVERGENT,
    EDGE,
    END_DECAY,
    FAINT,
    FAR,
    GUARD_DEPTH,
    HIDDEN,
    INSIDE,
    ISOLATE_DEPTH,
    ISOLATE_STEPS,
    ISOLATE_WIDTH,
    LARGEST_RATIO,
    LOCATE_HALVINGS,
    LOCATE_LOST,
    LOCATE_MOST,
    LOCATE_NARROW,
    LOCATE_SAME,
    LOCATE_STEPS,
    LOCATE_WIDTH,
    LOCATE_ZEROS,
    MAX_CUTS,
    MAX_DEPTH,
    MAX_EVALUATIONS,
    MAX_HALF_PLANES,
    MAX_HALF_SPACES,
    MAX_INTERVALS,
    NEAR,
    NEAR_SIDE,
    NEARLY,
    NEIGHBOUR,
    NOISE,
    PIECE_EPS,
    PLACED,
    POLE,
    RESIDUE,
    ROUNDING,
    SADDLE,
    SAME_MEANS,
    SMALLEST,
    SPENT,
    TANGENT,
    THIN,
    TIE_EPS,
    UNSEEN,
    WATCH_WIDTH,
    WEIGHED,
)
from teg.program.arrays import CHUNKS, COPIES, LEAST, TIE_FROM, TIE_TO, TOUCH

BLOCK = 64
"""Sobol' points in a block."""
MANY_IN_TILE = 24
"""The number of candidates seen in a tile, most of them without guards there, up to which it is not cut into four."""
MANY_CELLS = 24
"""The number of cells of one square from which on those beside a candidate are found by the cuts that made them."""
FEW = 16
"""The number of regions, or of lines, up to which they are sorted by insertion."""
NOTED = 64
"""Places of one square where lines may part that are kept apart; where there are more, all corners are looked at."""
SOME = 64
"""The number of keys of an interval up to which they are sorted by comparing all of them, side by side."""
PIECES, LINES = 8, 40
"""The numbers of regions of a square and of lines up to which there are cells with signs."""
ASLANT = 1e-4
"""The sine of the angle from which on it is sure where two lines cross, in squares that are computed side by side."""
CORNERS = 8
"""The number of corners up to which a polygon is a piece, whose corners are computed side by side."""


def room_of_solid(half_spaces: int) -> int:
    """Returns the largest number of corners, and of edges, of a box that half-spaces cut, with those that are cut off: each half-space adds
    one for each face that is there, at most."""
    return len(box_edges()) + sum(range(SIDES, SIDES + half_spaces))


LIMITS = {
    "TEG_BLOCK": BLOCK,
    "TEG_CHUNKS": CHUNKS,
    "TEG_COPIES": COPIES,
    "TEG_LEAST": LEAST,
    "TEG_PIECE_EPS": PIECE_EPS,
    "TEG_TIE_EPS": TIE_EPS,
    "TEG_TIE_FROM": TIE_FROM,
    "TEG_TIE_TO": TIE_TO,
    "TEG_TOUCHING": TOUCH,
    "TEG_WEIGHED": WEIGHED,
    "TEG_ROUNDING": ROUNDING,
    "TEG_MAX_DEPTH": MAX_DEPTH,
    "TEG_MAX_INTERVALS": MAX_INTERVALS,
    "TEG_MAX_EVALUATIONS": MAX_EVALUATIONS,
    "TEG_WATCH_WIDTH": WATCH_WIDTH,
    "TEG_NOISE": NOISE,
    "TEG_BOX_COST": BOX_COST,
    "TEG_DIVERGENT": DIVERGENT,
    "TEG_DEEP": DEEP,
    "TEG_SPENT": SPENT,
    "TEG_CANCELS": CANCELS,
    "TEG_CANCELLED": CANCELLED,
    "TEG_END_DECAY": END_DECAY,
    "TEG_UNSEEN": UNSEEN,
    "TEG_HIDDEN": HIDDEN,
    "TEG_FAINT": FAINT,
    "TEG_GUARD_DEPTH": GUARD_DEPTH,
    "TEG_NEAR": NEAR,
    "TEG_NEARLY": NEARLY,
    "TEG_THIN": THIN,
    "TEG_HALF_PLANES": MAX_HALF_PLANES,
    "TEG_CORNERS": 2 * (4 + MAX_HALF_PLANES),
    "TEG_HALF_SPACES": MAX_HALF_SPACES,
    "TEG_SOLID_FACES": SIDES + MAX_HALF_SPACES,
    "TEG_SOLID": room_of_solid(MAX_HALF_SPACES),
    "TEG_CLIP_EPS": CLIP_EPS,
    "TEG_SIDES": 2 * (4 + MAX_CUTS),
    "TEG_EDGE": EDGE,
    "TEG_PLACED": PLACED,
    "TEG_SAME_MEANS": SAME_MEANS,
    "TEG_AT_END": AT_END,
    "TEG_NEIGHBOUR": NEIGHBOUR,
    "TEG_FAR": FAR,
    "TEG_POLE": POLE,
    "TEG_RESIDUE": RESIDUE,
    "TEG_INSIDE": INSIDE,
    "TEG_NEAR_SIDE": NEAR_SIDE,
    "TEG_CLOSE_ENDS": CLOSE_ENDS,
    "TEG_TANGENT": TANGENT,
    "TEG_PI": math.pi,
    "TEG_LARGEST_RATIO": LARGEST_RATIO,
    "TEG_SADDLE": SADDLE,
    "TEG_BEYOND": BEYOND,
    "TEG_AT_REACH": AT_REACH,
    "TEG_SMALLEST": SMALLEST,
    "TEG_ISOLATE_DEPTH": ISOLATE_DEPTH,
    "TEG_ISOLATE_WIDTH": ISOLATE_WIDTH,
    "TEG_ISOLATE_STEPS": ISOLATE_STEPS,
    "TEG_LOCATE_HALVINGS": LOCATE_HALVINGS,
    "TEG_LOCATE_WIDTH": LOCATE_WIDTH,
    "TEG_LOCATE_MOST": LOCATE_MOST,
    "TEG_LOCATE_ZEROS": LOCATE_ZEROS,
    "TEG_LOCATE_STEPS": LOCATE_STEPS,
    "TEG_LOCATE_NARROW": LOCATE_NARROW,
    "TEG_LOCATE_SAME": LOCATE_SAME,
    "TEG_LOCATE_LOST": LOCATE_LOST,
    "TEG_ON_LINE": EPSILON,
    "TEG_KEY_ROUNDING": KEY_ROUNDING,
    "TEG_BESIDE": BESIDE,
    "TEG_ASLANT": ASLANT,
    "TEG_FEW": FEW,
    "TEG_SOME": SOME,
    "TEG_MARKED": MARKED,
    "TEG_PIECES": PIECES,
    "TEG_PIECE": CORNERS,
    "TEG_PIECE_LINES": LINES,
    "TEG_MANY_CELLS": MANY_CELLS,
    "TEG_MANY_IN_TILE": MANY_IN_TILE,
    "TEG_TILE_U": TILE_AT[0],
    "TEG_TILE_V": TILE_AT[1],
    "TEG_SAME": SAME,
    "TEG_ANGLES": 10.0**PLACES,
    "TEG_GUARDS": MOST_GUARDS,
    "TEG_NUDGE": NUDGE,
    "TEG_SLOW": SLOW,
    "TEG_PLACES": NOTED,
    "TEG_LIMIT": LIMIT,
    "TEG_PARTED": PARTED,
    "TEG_PARTING": PARTING,
    "TEG_SHIFT": SHIFT,
    "TEG_SKEW": SKEW,
    "TEG_MONOMIALS": len(monomials(MOST_DEGREE)),
}


TOPICS = (
    "core",
    "calls",
    "lanes",
    "exponential",
    "trigonometric",
    "polygon",
    "polyhedron",
    "quadrature",
    "bends",
    "hyperbola",
    "ellipse",
    "roots",
    "places",
    "samples",
    "pieces",
    "arrangement",
    "insertion",
    "regions",
    "twins",
    "side_lines",
    "measures",
    "cells",
    "envelope",
    "signed",
    "fans",
    "kept",
    "eights",
    "gaps",
)
"""The headers, in the order in which they build on one another."""
UNIT = "//: "
"""What begins the line before a unit, a type or a function that is printed if it is used; its name follows."""


def runtime(texts: Sequence[str], behind: Mapping[str, str] | None = None) -> list[str]:
    """Returns the part of the runtime that these texts need, directly or through other parts, and its constants; `behind` are texts that
    follow a unit at once, by its name."""
    needed = {name for text in texts for name in identifiers(text)}
    always, units = read_headers()
    parts: list[str] = []
    for name, unit in reversed(units):
        if name in needed:
            parts[:0] = [unit, *([behind[name]] if behind and name in behind else [])]
            needed.update(identifiers(unit))
    defines = [f"#define {name} {value!r}" for name, value in LIMITS.items() if name in needed]
    return [always, *(["\n".join(defines)] if defines else []), *parts]


@cache
def read_headers() -> tuple[str, list[tuple[str, str]]]:
    """Returns the text that every kernel needs, and the units of all headers, with their names and texts. A unit needs only units before
    it."""
    units: list[tuple[str, str]] = []
    for topic in reversed(TOPICS):
        always, *parts = Path(__file__).with_name(f"{topic}.h").read_text(encoding="ascii").split(UNIT)
        named = [part.split("\n", 1) for part in parts]
        units = [*((name, text.strip()) for name, text in named), *units]
    return always.strip(), units
