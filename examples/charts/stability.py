"""The difficult cases of the stability table, in groups."""

from __future__ import annotations

from teg.examples.charts.case import Case
from teg.examples.charts.curves import BIRTHS, TANGENCIES
from teg.examples.charts.disguises import NARROW, POWERS, ROOTS, SINGULAR, WORDS
from teg.examples.charts.scales import COEFFICIENTS, EXTREMES, SLIVERS
from teg.examples.charts.ties import BOUNDS, TIES

GROUPS: dict[str, tuple[Case, ...]] = {
    "ties": TIES,
    "bounds and singular integrands": BOUNDS,
    "curves that touch": TANGENCIES,
    "births and crossings": BIRTHS,
    "slivers and stripes": SLIVERS,
    "coefficients that vanish": COEFFICIENTS,
    "extreme scales": EXTREMES,
    "one surface in two expressions": WORDS,
    "narrow features": NARROW,
    "powers, literals, far coordinates": POWERS,
    "singularities that move": SINGULAR,
    "many and double roots": ROOTS,
}
CASES: tuple[Case, ...] = tuple(c for group in GROUPS.values() for c in group)
