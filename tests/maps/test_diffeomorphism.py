"""Maps: what is verified when they are made, their composition and inverse, and the maps of the library."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest

import teg
from teg import Diffeomorphism, maps
from teg.analysis.evaluate import values_of
from teg.errors import BoundError, DiffeomorphismError, NameClashError, OperandError, OptionError, ParameterError, ScopeError
from teg.ir.expr import ONE, Const, Expr
from teg.maps.diffeomorphism import INFINITY, MINUS_INFINITY
from teg.maps.identities import simplified, taken_out

x, y, z, r, p, q, u, v, w = teg.vars("x y z r p q u v w")
a, b, k = teg.params("a b k")
TURN = (-math.pi, math.pi)


def polar_by_hand(**options: object) -> Diffeomorphism:
    return Diffeomorphism(
        {x: r * teg.cos(p), y: r * teg.sin(p)},
        inverse={r: teg.sqrt(x**2 + y**2), p: teg.atan2(y, x)},
        domain={r: (0, None), p: TURN},
        **options,  # type: ignore[arg-type]
    )


# -- what a map knows ----------------------------------------------------------------------------------------------------


def test_the_jacobian_is_derived_and_simplified() -> None:
    assert polar_by_hand().jacobian is r
    assert polar_by_hand().weight() is r
    assert Diffeomorphism({x: k * u + v, y: v}, {u: (x - y) / k, v: y}).jacobian is k


def test_a_given_jacobian_may_be_the_absolute_value() -> None:
    m = Diffeomorphism({x: -2 * u}, {u: x / -2}, jacobian=2)
    assert values_of([m.weight()], {}) == [2.0]
    assert Diffeomorphism({x: -2 * u}, {u: x / -2}).weight() is Diffeomorphism({x: 2 * u}, {u: x / 2}).weight()


def test_the_orientation_may_depend_on_parameters() -> None:
    m = maps.scaling(x, u, k)
    assert [float(values_of([m.weight()], {k: np.asarray(value)})[0]) for value in (-3.0, 2.0)] == [3.0, 2.0]


def test_old_and_new_variables_and_parameters() -> None:
    m = teg.polar(x, y, r, p, centre=(a, 2 * b))
    assert m.old == (x, y)
    assert m.new == (r, p)
    assert m.parameters == (a, b)
    assert m.domain[r] == (teg.ir.expr.ZERO, INFINITY)


def test_maps_are_immutable_and_pickle() -> None:
    m = teg.polar(x, y, r, p, (a, 0))
    with pytest.raises(AttributeError):
        m.jacobian = ONE  # type: ignore[misc]
    again = pickle.loads(pickle.dumps(m))
    assert again.forward == m.forward
    assert again.domain == m.domain
    assert again.jacobian is m.jacobian


# -- what is no map ------------------------------------------------------------------------------------------------------


def test_the_wrong_inverse() -> None:
    with pytest.raises(DiffeomorphismError) as caught:
        Diffeomorphism({x: 2 * u}, inverse={u: x / 3})
    error = caught.value
    assert error.point is not None
    assert error.values is not None
    assert error.values[0] == error.point["u"]
    assert error.values[1] == pytest.approx(error.point["u"] * 2 / 3)
    assert "u = " in str(error)
    assert all(repr(value) in str(error) for value in error.values)


def test_a_map_that_is_not_one_to_one() -> None:
    """u² on (-1, 1): -½ and ½ have one image, and the inverse can give one of them only."""
    with pytest.raises(DiffeomorphismError) as caught:
        Diffeomorphism({x: u**2}, inverse={u: teg.sqrt(x)}, domain={u: (-1, 1)})
    assert caught.value.point is not None
    assert caught.value.values == pytest.approx((caught.value.point["u"], -caught.value.point["u"]))
    Diffeomorphism({x: u**2}, inverse={u: teg.sqrt(x)}, domain={u: (0, 1)})


def test_polar_coordinates_beyond_a_turn() -> None:
    with pytest.raises(DiffeomorphismError) as caught:
        Diffeomorphism(
            {x: r * teg.cos(p), y: r * teg.sin(p)},
            inverse={r: teg.sqrt(x**2 + y**2), p: teg.atan2(y, x)},
            domain={r: (0, None), p: (0, 2 * math.pi)},
        )
    assert caught.value.values is not None
    assert caught.value.values[0] - caught.value.values[1] == pytest.approx(2 * math.pi)


def test_the_wrong_jacobian() -> None:
    with pytest.raises(DiffeomorphismError) as caught:
        polar_by_hand(jacobian=2 * r)
    assert caught.value.point is not None
    assert caught.value.values == pytest.approx((caught.value.point["r"], 2 * caught.value.point["r"]))


def test_a_jacobian_that_changes_its_sign() -> None:
    """One-to-one, but the second half runs backwards."""
    there = teg.where(u < 0.5, u, 1.5 - u)
    back = teg.where(x < 0.5, x, 1.5 - x)
    with pytest.raises(DiffeomorphismError) as caught:
        Diffeomorphism({x: there}, inverse={u: back}, domain={u: (0, 1)})
    assert caught.value.values is not None
    assert caught.value.values[0] * caught.value.values[1] < 0


def test_a_jacobian_that_vanishes_and_a_forward_map_that_is_not_a_number() -> None:
    with pytest.raises(DiffeomorphismError) as caught:
        maps.affine((x, y), (u, v), [[1, 2], [2, 4]])
    assert caught.value.values is not None
    with pytest.raises(DiffeomorphismError) as caught:
        Diffeomorphism({x: teg.log(u)}, inverse={u: teg.exp(x)}, domain={u: (-1, 1)})
    assert caught.value.values is not None
    assert not math.isfinite(caught.value.values[1])


def test_the_error_pickles_with_its_point() -> None:
    with pytest.raises(DiffeomorphismError) as caught:
        Diffeomorphism({x: 2 * u}, inverse={u: x / 3})
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.point, again.values) == (caught.value.point, caught.value.values)


def test_parameters_are_checked_at_the_values_given() -> None:
    forward, inverse = {x: u**k}, {u: x ** (1 / k)}
    Diffeomorphism(forward, inverse, domain={u: (0, None)}, check_at={k: 3})
    with pytest.raises(DiffeomorphismError) as caught:
        Diffeomorphism(forward, inverse, domain={u: (0, None)}, check_at={"k": 0})
    assert caught.value.point is not None
    assert caught.value.point["k"] == 0.0
    with pytest.raises(ParameterError):
        Diffeomorphism(forward, inverse, domain={u: (0, None)}, check_at={"other": 1.0})


def test_mistakes_in_variables_and_names() -> None:
    with pytest.raises(ScopeError):
        Diffeomorphism({x: u, y: v}, {u: x})
    with pytest.raises(ScopeError):
        Diffeomorphism({x: x + 1}, {x: x - 1})
    with pytest.raises(ScopeError):
        Diffeomorphism({x: u + w}, {u: x - w})
    with pytest.raises(ScopeError):
        Diffeomorphism({}, {})
    with pytest.raises(ScopeError):
        Diffeomorphism({a: u}, {u: x})  # type: ignore[dict-item]
    with pytest.raises(ScopeError):
        Diffeomorphism({x: u}, {u: x}, domain={v: (0, 1)})
    with pytest.raises(NameClashError):
        Diffeomorphism({x: u + teg.param("u")}, {u: x - teg.param("u")})
    with pytest.raises(OperandError):
        Diffeomorphism({x: u + teg.integral(y, (y, 0, 1))}, {u: x - 0.5})
    with pytest.raises(BoundError):
        Diffeomorphism({x: u}, {u: x}, bounds={u: (0, None)})
    with pytest.raises(BoundError):
        polar_by_hand(bounds={p: (-4, 4)})
    with pytest.raises(OptionError):
        teg.compile(teg.integral(x, (x, 0, 1)), maps=polar_by_hand())  # type: ignore[arg-type]


# -- composition and inverse ---------------------------------------------------------------------------------------------


def agree(m: Diffeomorphism, other: Diffeomorphism, samples: dict[object, float]) -> None:
    """Two maps with the same variables do the same at a point of the new variables."""
    at = {name: np.asarray(value) for name, value in samples.items()}
    for e, f in zip([*m.forward.values(), m.weight()], [*other.forward.values(), other.weight()], strict=True):
        assert values_of([e], at)[0] == pytest.approx(values_of([f], at)[0], rel=1e-13)


def test_composition() -> None:
    moved = maps.translation((x, y), (u, v), (a, b)) @ teg.polar(u, v, r, p)
    agree(moved, teg.polar(x, y, r, p, (a, b)), {r: 0.7, p: 2.1, a: 0.3, b: -0.4})
    assert moved.then(maps.scaling(r, q, 2)).new == (q, p)
    moved.verify({a: 0.3, b: -2.0})


def test_composition_carries_domains_over() -> None:
    polar = polar_by_hand()
    assert (polar @ maps.translation(r, q, -1)).domain[q] == (ONE, INFINITY)
    assert (polar @ maps.scaling(r, q, -1)).domain[q] == (MINUS_INFINITY, teg.ir.expr.ZERO)
    assert (polar @ maps.exponential(r, q)).domain[q] == (MINUS_INFINITY, INFINITY)
    turned = polar @ maps.rotation(r, p, u, v, 0.5)
    assert len(turned.within) == 2
    turned.verify({})


def test_composition_refuses_other_variables() -> None:
    with pytest.raises(ScopeError):
        polar_by_hand() @ maps.translation(x, u, 1)
    with pytest.raises(ScopeError):
        polar_by_hand() @ maps.translation(r, x, 1)
    with pytest.raises(OperandError):
        polar_by_hand() @ 3


def test_the_inverse_map() -> None:
    m = teg.polar(x, y, r, p, (a, 0))
    back = m.inverse_map()
    assert back.old == (r, p)
    assert back.new == (x, y)
    back.verify({a: 0.3})
    agree(back.inverse_map(), m, {r: 0.7, p: 2.1, a: 0.3})


def test_a_batch_of_parameters_is_verified_element_by_element() -> None:
    m = maps.scaling(x, u, k)
    m.verify({k: np.array([0.5, 2.0, -3.0])})
    with pytest.raises(DiffeomorphismError) as caught:
        m.verify({k: np.array([0.5, 2.0, 0.0])})
    assert caught.value.point is not None
    assert caught.value.point["k"] == 0.0


# -- the library ---------------------------------------------------------------------------------------------------------

LIBRARY: dict[str, Callable[[], Diffeomorphism]] = {
    "translation": lambda: maps.translation((x, y), (u, v), (a, -2)),
    "scaling": lambda: maps.scaling((x, y), (u, v), (a, -2)),
    "rotation": lambda: maps.rotation(x, y, u, v, a, centre=(b, 1)),
    "shear": lambda: maps.shear(x, y, u, v, a),
    "affine of three": lambda: maps.affine((x, y, z), (u, v, w), [[a, 1, 0], [0.5, 2, b], [1, 0, 3]], (b, 0, 1)),
    "smoothstep": lambda: maps.smoothstep(x, u, (a, a + 2)),
    "exponential": lambda: maps.exponential(x, u),
    "logarithm": lambda: maps.logarithm(x, u),
    "polar": lambda: teg.polar(x, y, r, p, (a, b)),
    "elliptic": lambda: maps.elliptic(x, y, u, v, a),
    "parabolic": lambda: maps.parabolic(x, y, u, v),
    "hyperbolic": lambda: maps.hyperbolic(x, y, u, v),
    "cylindrical": lambda: maps.cylindrical(x, y, z, r, p, w, (a, b)),
    "spherical": lambda: maps.spherical(x, y, z, r, q, p, (a, b, 1)),
}


@pytest.mark.parametrize("name", LIBRARY)
def test_the_library_of_maps(name: str) -> None:
    m = LIBRARY[name]()
    for sign in (1.0, -1.0):
        values = {parameter: sign * (0.3 + 0.4 * i) for i, parameter in enumerate(m.parameters)}
        if name != "elliptic" or sign > 0:
            m.verify(values, derive=True)
            m.inverse_map().verify(values)


def test_the_library_refuses_what_does_not_go_together() -> None:
    with pytest.raises(ScopeError):
        maps.translation((x, y), (u, v), 1)
    with pytest.raises(ScopeError):
        maps.affine((x, y), (u, v), [[1, 2]])


# -- identities ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("e", "simple"),
    [
        ((r * teg.cos(p)) ** 2 + (r * teg.sin(p)) ** 2, r**2),
        (teg.exp(-((r * teg.cos(p)) ** 2) - (r * teg.sin(p)) ** 2), teg.exp(-(r**2))),
        (teg.cosh(u) ** 2 - teg.sinh(u) ** 2, ONE),
        (teg.sqrt(r**2 * teg.sin(q) ** 2), r * teg.sin(q)),
        (teg.sqrt(x**2 + y**2) * teg.cos(teg.atan2(y, x)), x),
        ((x**2 + y**2) * teg.cos(teg.atan2(y, x)) * teg.sin(teg.atan2(y, x)), y * x),
        (v * teg.exp(u) * teg.exp(-u), v),
        (teg.log(teg.exp(u)), u),
        (teg.sqrt(u**2), teg.sqrt(u**2)),
    ],
)
def test_identities(e: Expr, simple: Expr) -> None:
    zero, infinity = Const.make(0.0, ()), Const.make(math.inf, ())
    box = {r: (zero, infinity), q: (zero, Const.make(math.pi, ()))}
    assert simplified(e, box) is simple


def test_a_common_positive_factor_is_taken_out() -> None:
    factor, rest = taken_out(a * teg.exp(u) - v * teg.exp(u), {})
    assert factor is teg.exp(u)
    assert rest is a - v
    assert taken_out(a * v - v * u, {}) == (ONE, a * v - v * u)


def test_identities_do_not_grow_deep_sums() -> None:
    e: Expr = x
    for i in range(3000):
        e = e + teg.sin(p) * i + teg.cos(p)
    assert simplified(e).free == {x, p}
