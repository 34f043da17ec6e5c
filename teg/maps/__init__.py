"""Common maps, as `teg.Diffeomorphism`s. Arguments: the old variables, the new variables, then the parameters of the map.

    m = teg.maps.rotation(x, y, u, v, angle) @ teg.maps.scaling((u, v), (p, q), (2, 3))
    teg.change_variables(e, m);  teg.compile(e, maps=[m])

The parameters of a map (a centre, an angle, a matrix) may be numbers or expressions of program parameters, by which derivatives are
taken. In the integrals that a map makes, the first new variable is innermost. Angles are in radians. `polar` is `teg.polar` too.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import cast

from teg.errors import ScopeError
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.expr import Expr, Operand, Var
from teg.ir.operands import as_number
from teg.language.functions import asin, atan2, cos, cosh, exp, log, sin, sinh, sqrt
from teg.language.programs import where
from teg.maps.diffeomorphism import Diffeomorphism

Point = tuple[object, object]
_TURN = (-math.pi, math.pi)

# -- straight ------------------------------------------------------------------------------------------------------------


def translation(old: Var | Sequence[Var], new: Var | Sequence[Var], by: object) -> Diffeomorphism:
    """Returns the map x = u + a, of one variable or several. The image of a box is a box. Raises ScopeError for unequal numbers.

    str(teg.maps.translation((x, y), (u, v), (t, 1)))  # <teg.Diffeomorphism x = u + t, y = v + 1>
    """
    rows = _rows(old, new, by)
    return Diffeomorphism({x: u + a for x, u, a in rows}, {u: x - a for x, u, a in rows}, jacobian=1)


def scaling(old: Var | Sequence[Var], new: Var | Sequence[Var], by: object) -> Diffeomorphism:
    """Returns the map x = a·u, a not 0, of one variable or several. The image of a box is a box. Raises ScopeError for unequal numbers.

    str(teg.maps.scaling((x, y), (u, v), (t, 2)))      # <teg.Diffeomorphism x = t·u, y = 2·v>
    """
    rows = _rows(old, new, by)
    return Diffeomorphism({x: a * u for x, u, a in rows}, {u: x / a for x, u, a in rows}, jacobian=simplify.mul(*(a for _, _, a in rows)))


def rotation(x: Var, y: Var, u: Var, v: Var, angle: Operand, centre: Point = (0, 0)) -> Diffeomorphism:
    """Returns the map of (u, v) turned by the angle (radians) about (0, 0), then moved to the centre (a, b).

        str(teg.maps.rotation(x, y, u, v, t).forward[x])   # u·cos(t) - v·sin(t)

    x = a + u·cos - v·sin, y = b + u·sin + v·cos.
    """
    c, s = cos(angle), sin(angle)
    a, b = map(as_number, centre)
    return Diffeomorphism(
        {x: a + u * c - v * s, y: b + u * s + v * c}, {u: (x - a) * c + (y - b) * s, v: (y - b) * c - (x - a) * s}, jacobian=1
    )


def shear(x: Var, y: Var, u: Var, v: Var, slope: object) -> Diffeomorphism:
    """Returns the map x = u + slope·v, y = v. The image of a box is a nest of integrals, with no brackets.

    str(teg.maps.shear(x, y, u, v, t))                 # <teg.Diffeomorphism x = u + t·v, y = v>
    """
    k = as_number(slope)
    return Diffeomorphism({x: u + k * v, y: cast(Expr, v)}, {u: x - k * y, v: y}, jacobian=1)


def affine(
    old: Sequence[Var], new: Sequence[Var], matrix: Sequence[Sequence[object]], offset: Sequence[object] | None = None
) -> Diffeomorphism:
    """Returns the map x = A·u + b, with a matrix A, given by rows, whose determinant is not 0. Raises ScopeError for another size of A.

    str(teg.maps.affine((x, y), (u, v), [[1, t], [0, 2]]))  # <teg.Diffeomorphism x = u + t·v, y = 2·v>
    """
    n = len(old)
    if len(matrix) != n or any(len(row) != n for row in matrix):
        raise ScopeError(f"the matrix of {n} old variables must have {n} rows of {n} entries", None, "[[a, b], [c, d]]")
    a = [[as_number(e) for e in row] for row in matrix]
    b = [as_number(e) for e in (offset if offset is not None else [0] * n)]
    rows = _rows(old, new, b)
    determinant = _determinant(a)
    forward = {x: simplify.add(*(simplify.mul(a[i][j], u) for j, u in enumerate(new)), b[i]) for i, (x, _, _) in enumerate(rows)}
    inverse: dict[Var, object] = {}
    for j, u in enumerate(new):
        cofactors = [_minor(a, i, j) if (i + j) % 2 == 0 else simplify.mul(ex.MINUS_ONE, _minor(a, i, j)) for i in range(n)]
        inverse[u] = simplify.div(simplify.add(*(simplify.mul(c, x - d) for c, x, d in zip(cofactors, old, b, strict=True))), determinant)
    return Diffeomorphism(forward, inverse, jacobian=determinant)


def _minor(a: Sequence[Sequence[Expr]], row: int, column: int) -> Expr:
    return _determinant([[e for j, e in enumerate(r) if j != column] for i, r in enumerate(a) if i != row])


def _determinant(a: Sequence[Sequence[Expr]]) -> Expr:
    """Returns the determinant as a sum over all permutations, for matrices of a few rows."""
    terms = []
    for order in itertools.permutations(range(len(a))):
        swaps = sum(i > j for i, j in itertools.combinations(order, 2))
        terms.append(simplify.mul(ex.const(-1.0 if swaps % 2 else 1.0), *(a[i][j] for i, j in enumerate(order))))
    return simplify.add(*terms)


def _rows(old: Var | Sequence[Var], new: Var | Sequence[Var], shape: object) -> list[tuple[Var, Var, Expr]]:
    """Returns triples (old variable, new variable, number), for one variable or several."""
    if isinstance(old, Var) and isinstance(new, Var):
        return [(old, new, as_number(shape))]
    if isinstance(old, Var) or isinstance(new, Var) or not isinstance(shape, Sequence) or not len(old) == len(new) == len(shape):
        raise ScopeError(
            f"{old!r:.60}, {new!r:.60} and {shape!r:.60} do not go together", None, "give one of each, or three sequences of one length"
        )
    return [(x, u, as_number(a)) for x, u, a in zip(old, new, shape, strict=True)]


# -- of one variable -----------------------------------------------------------------------------------------------------


def smoothstep(x: Var, u: Var, edges: Point = (0, 1)) -> Diffeomorphism:
    """Returns the map x = l + (h - l)·(3u² - 2u³), 0 < u < 1, with edges (l, h). Integrals inside the edges only.

        e = teg.change_variables(teg.integral(teg.sqrt(x), (x, 0, 1)), teg.maps.smoothstep(x, u))
        teg.evaluate(e)                                    # 0.6666666666666666

    Nodes gather at both edges, where the Jacobian is 0.
    """
    lo, hi = map(as_number, edges)
    share = (x - lo) / (hi - lo)
    return Diffeomorphism(
        {x: lo + (hi - lo) * (3 * u**2 - 2 * u**3)},
        {u: 0.5 - sin(asin(1 - 2 * share) / 3)},
        domain={u: (0, 1)},
        jacobian=6 * (hi - lo) * u * (1 - u),
    )


def exponential(x: Var, u: Var) -> Diffeomorphism:
    """Returns the map x = exp(u), for integrals over x > 0.

    e = teg.change_variables(teg.integral(1 / x, (x, 1, t)), teg.maps.exponential(x, u))
    str(e)                                             # ∫[u: 0..log(t)] 1
    """
    return Diffeomorphism({x: exp(u)}, {u: log(x)}, jacobian=exp(u))


def logarithm(x: Var, u: Var) -> Diffeomorphism:
    """Returns the map x = log(u), u > 0.

    e = teg.change_variables(teg.integral(teg.exp(x), (x, 0, 1)), teg.maps.logarithm(x, u))
    teg.evaluate(e)                                    # 1.718281828459045
    """
    return Diffeomorphism({x: log(u)}, {u: exp(x)}, domain={u: (0, None)}, jacobian=1 / u)


# -- of the plane --------------------------------------------------------------------------------------------------------


def polar(x: Var, y: Var, r: Var, p: Var, centre: Point = (0, 0)) -> Diffeomorphism:
    """Returns the map x = a + r·cos p, y = b + r·sin p, with the centre (a, b), r > 0, -π < p < π.

        e = teg.integral(teg.bracket(x**2 + y**2 < t), (x, -1, 1), (y, -1, 1))
        f = teg.compile(e, [t], maps=[teg.polar(x, y, r, p)])
        f.grad(t=0.5)                                      # {'t': 3.141592653589793}

    Circles about the centre are r = …, rays from it p = …
    """
    a, b = map(as_number, centre)
    return Diffeomorphism(
        {x: a + r * cos(p), y: b + r * sin(p)},
        {r: sqrt((x - a) ** 2 + (y - b) ** 2), p: atan2(y - b, x - a)},
        domain={r: (0, None), p: _TURN},
        jacobian=r,
    )


def elliptic(x: Var, y: Var, u: Var, v: Var, focus: object = 1) -> Diffeomorphism:
    """Returns the map x = c·cosh u·cos v, y = c·sinh u·sin v, u > 0, -π < v < π, with the foci (±c, 0), c > 0.

        str(teg.maps.elliptic(x, y, u, v).forward[x])      # cosh(u)·cos(v)

    Ellipses are u = …, hyperbolas v = …
    """
    c = as_number(focus)
    sum_of_distances = sqrt((x + c) ** 2 + y**2) + sqrt((x - c) ** 2 + y**2)
    ratio = sum_of_distances / (2 * c)
    grown = log(ratio + simplify.call("root", ratio**2 - 1))
    return Diffeomorphism(
        {x: c * cosh(u) * cos(v), y: c * sinh(u) * sin(v)},
        {u: grown, v: atan2(y * cosh(grown), x * sinh(grown))},
        domain={u: (0, None), v: _TURN},
        jacobian=c**2 * (sinh(u) ** 2 + sin(v) ** 2),
    )


def parabolic(x: Var, y: Var, u: Var, v: Var) -> Diffeomorphism:
    """Returns the map x = (u² - v²)/2, y = u·v, v > 0: parabolas u = … and v = … with their focus at (0, 0).

    str(teg.maps.parabolic(x, y, u, v).forward[y])     # u·v
    """
    distance = sqrt(x**2 + y**2)
    return Diffeomorphism(
        {x: (u**2 - v**2) / 2, y: u * v},
        {u: where(y < 0, -sqrt(distance + x), sqrt(distance + x)), v: sqrt(distance - x)},
        domain={v: (0, None)},
        jacobian=u**2 + v**2,
    )


def hyperbolic(x: Var, y: Var, u: Var, v: Var) -> Diffeomorphism:
    """Returns the map x = v·exp(u), y = v·exp(-u), v > 0: hyperbolas x·y = v² and rays, in the quadrant x > 0, y > 0.

    str(teg.maps.hyperbolic(x, y, u, v).jacobian)      # 2·v
    """
    return Diffeomorphism({x: v * exp(u), y: v * exp(-u)}, {u: 0.5 * log(x / y), v: sqrt(x * y)}, domain={v: (0, None)}, jacobian=2 * v)


# -- of space ------------------------------------------------------------------------------------------------------------


def cylindrical(x: Var, y: Var, z: Var, r: Var, p: Var, h: Var, centre: Point = (0, 0)) -> Diffeomorphism:
    """Returns the map x = a + r·cos p, y = b + r·sin p, z = h, with the axis through (a, b), r > 0, -π < p < π.

    z, h = teg.vars("z h")
    str(teg.maps.cylindrical(x, y, z, r, p, h).jacobian)  # r
    """
    a, b = map(as_number, centre)
    return Diffeomorphism(
        {x: a + r * cos(p), y: b + r * sin(p), z: h},
        {r: sqrt((x - a) ** 2 + (y - b) ** 2), p: atan2(y - b, x - a), h: z},
        domain={r: (0, None), p: _TURN},
        jacobian=r,
    )


def spherical(x: Var, y: Var, z: Var, r: Var, theta: Var, phi: Var, centre: tuple[object, object, object] = (0, 0, 0)) -> Diffeomorphism:
    """Returns the map x = a + r·sin θ·cos φ, y = b + r·sin θ·sin φ, z = c + r·cos θ, with the centre (a, b, c).

        z, theta, phi = teg.vars("z theta phi")
        str(teg.maps.spherical(x, y, z, r, theta, phi).jacobian)  # r²·sin(theta)

    r > 0; 0 < θ < π from the z axis; -π < φ < π around it.
    """
    a, b, c = map(as_number, centre)
    across = (x - a) ** 2 + (y - b) ** 2
    return Diffeomorphism(
        {x: a + r * sin(theta) * cos(phi), y: b + r * sin(theta) * sin(phi), z: c + r * cos(theta)},
        {r: sqrt(across + (z - c) ** 2), theta: atan2(sqrt(across), z - c), phi: atan2(y - b, x - a)},
        domain={r: (0, None), theta: (0, math.pi), phi: _TURN},
        jacobian=r**2 * sin(theta),
    )
