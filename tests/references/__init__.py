"""Problems with exact values and derivatives, to 20 digits and more; every backend and derivative order runs over them.

Tags: the family (`1d-affine`, `2d-affine`, `iterated`, …), by which the problems are divided into files; `later` for surfaces that no
family reduces yet; `tie` where the derivative is the mean over the two orders of coinciding surfaces; `coincident` where surfaces meet
but the derivative exists; `birth` where a region is born; `slow` for what takes seconds; the rest names what is special.
"""

from __future__ import annotations

from tests.references.curves import CURVES
from tests.references.half_planes import HALF_PLANES
from tests.references.nested import NESTED
from tests.references.problem import Reference
from tests.references.stability import STABILITY
from tests.references.steps import STEPS
from tests.references.triangles import TRIANGLES

__all__ = ["REFERENCES", "Reference", "tagged", "untagged"]

REFERENCES: tuple[Reference, ...] = (*STEPS, *HALF_PLANES, *TRIANGLES, *CURVES, *NESTED, *STABILITY)


def tagged(*tags: str) -> list[Reference]:
    """The references that carry all of these tags."""
    return [r for r in REFERENCES if set(tags) <= set(r.tags)]


def untagged(*tags: str) -> list[Reference]:
    """The references that carry none of these tags."""
    return [r for r in REFERENCES if not set(tags) & set(r.tags)]
