"""The fast paths of one shape of program, each in a folder of its own; only this list names them.

    polygon      polynomials on half-planes or half-spaces over a box, and on half-lines over an interval: the domain is clipped
    hyperbola    polynomials on either side of a bilinear surface over a box, and along it: moments in closed form
    ellipse      polynomials on either side of an ellipse over a box, and along it: moments by its chords and arcs
    pole         polynomials over a power of a linear function: Gauss nodes with weights of their own

They are used where no rule and no order is asked for, and can be turned off (`intrinsics=False`): the general path computes the same
integrals by pieces, with which the tests of an intrinsic compare it. To add one: a folder with an `Intrinsic` (`teg.passes.lower.
intrinsic`) in it, a line here, and, if it has a statement of its own, that statement in `teg.program` and in the backends.
"""

from __future__ import annotations

from teg.analysis.remarks import Remarks
from teg.analysis.settings import Integration
from teg.passes.eliminate.families import Closed, noted
from teg.passes.intrinsics.ellipse import ELLIPSE
from teg.passes.intrinsics.hyperbola import HYPERBOLA
from teg.passes.intrinsics.pole import POLE
from teg.passes.intrinsics.polygon import POLYGON
from teg.passes.lower.intrinsic import Intrinsic, Statement
from teg.program.arrays import ArrayProgram

INTRINSICS: tuple[Intrinsic, ...] = (HYPERBOLA, ELLIPSE, POLYGON, POLE)
"""In the order in which they are tried."""
STATEMENTS: dict[type, Statement] = {kind: known for intrinsic in INTRINSICS for kind, known in intrinsic.statements.items()}
"""The data of the statements of all intrinsics, whether the intrinsics are turned on or not."""


def intrinsics_for(how: Integration) -> tuple[Intrinsic, ...]:
    """Returns the intrinsics that may be used: all, or none."""
    return INTRINSICS if how.closed_forms else ()


def with_loops(program: ArrayProgram) -> ArrayProgram:
    """Returns a program with arrays after the passes of intrinsics over loops around their statements."""
    for intrinsic in INTRINSICS:
        program = program if intrinsic.loops is None else intrinsic.loops(program)
    return program


def boundary_terms(remarks: Remarks | None = None) -> tuple[Closed, ...]:
    """Returns the closed forms of boundary terms that are not differentiated again. Uses of them are added to `remarks`."""
    known = Remarks() if remarks is None else remarks
    return tuple(noted(i.boundary, i.name, known) for i in INTRINSICS if i.boundary is not None)
