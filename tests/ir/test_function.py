"""`teg.function`: what it accepts, what an application means, when it is written out, and how it prints."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import numpy as np
import pytest

import teg
from teg.analysis.bodies import body_of, write_all_out
from teg.analysis.polynomial import Point, Shadow
from teg.errors import NameClashError, OperandError, OptionError, ParameterError, ScopeError
from teg.ir.expr import Expr
from teg.ir.function import Apply, Function
from teg.passes.normalise.inline import PEAKED, STEEP, reasons, with_slots, without_slots, write_out

x, y, z = teg.vars("x y z")
u, v, k, t, a = teg.params("u v k t a")
WAVE = teg.sin(u) * v + k / (1 + u * u)
AT = {"t": 0.6, "k": 0.3, "a": 0.4}


def wave(**options: bool | None) -> Function:
    return teg.function("wave", [u, v], WAVE, **options)


# -- what it accepts -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("formals", [[u, v], (u, v), [x, v], [x, y]])
def test_formals_are_parameters_or_variables(formals: list[Expr]) -> None:
    f = teg.function("f", formals, formals[0] * formals[0] - 3 * formals[1])
    assert teg.evaluate(f(2.0, t), {t: 5.0}) == -11.0


@pytest.mark.parametrize(
    ("make", "error", "word"),
    [
        (lambda: teg.function("", [u], u), OperandError, "empty"),
        (lambda: teg.function(3, [u], u), OperandError, "3"),
        (lambda: teg.function("f", u, u), ParameterError, "list"),
        (lambda: teg.function("f", "u", u), ParameterError, "'u'"),
        (lambda: teg.function("f", [u + 1], u), ParameterError, "argument"),
        (lambda: teg.function("f", [u, teg.var("u")], u), NameClashError, "twice"),
        (lambda: teg.function("f", [u, u], u), NameClashError, "twice"),
        (lambda: teg.function("f", [teg.var("k")], k), NameClashError, "'k'"),
        (lambda: teg.function("f", [u], u + x), ScopeError, "x"),
        (lambda: teg.function("f", [u], teg.tuple(u, u)), OperandError, "tuple"),
        (lambda: teg.function("f", [u], u < 1), TypeError, "bracket"),
        (lambda: teg.function("f", [u], u * teg.array("V")[0]), OperandError, "array"),
        (lambda: teg.function("f", [u], teg.sum(u, (teg.index("i"), 0, 3))), OperandError, "sum"),
        (lambda: teg.function("f", [x], teg.delta(x - t)), OperandError, "delta"),
        (lambda: teg.function("f", [u], u, inline="yes"), OptionError, "yes"),
        (lambda: wave()(1.0), OperandError, "takes 2 arguments, and was given 1"),
        (lambda: wave()(1.0, 2.0, 3.0), OperandError, "3"),
        (lambda: wave()(x < 1, 2.0), TypeError, "number"),
        (lambda: wave()(teg.delta(x), 2.0), OperandError, "delta"),
        (lambda: teg.compile(t, functions="both"), OptionError, "both"),
    ],
)
def test_what_is_wrong_is_told(make: Callable[[], object], error: type[Exception], word: str) -> None:
    with pytest.raises(error) as caught:
        make()
    assert isinstance(caught.value, teg.TegError)
    assert word in str(caught.value)


def test_other_parameters_of_the_body_are_arguments_of_the_program() -> None:
    f = teg.compile(teg.integral(wave()(x, t), (x, 0, 1)))
    assert sorted(f.parameters) == ["k", "t"]


def test_equal_functions_are_one_and_pickle() -> None:
    f = wave()
    assert wave() is f
    assert pickle.loads(pickle.dumps(f)) is f
    assert copy.deepcopy(f) is f
    e = f(x, t) * 2
    assert pickle.loads(pickle.dumps(e)) is e
    assert teg.function("other", [u, v], WAVE) is not f


def test_formals_mean_nothing_outside() -> None:
    inside = teg.function("f", [x], x * x)(teg.integral(x, (x, 0, u)))  # the argument has a variable and a parameter of these names
    assert teg.evaluate(inside, {u: 2.0}) == 4.0


def test_a_variable_bound_in_the_body_captures_nothing() -> None:
    f = teg.function("f", [u], teg.integral(u * x, (x, 0, 1)))
    assert teg.evaluate(teg.integral(f(x), (x, 0, 1))) == pytest.approx(0.25, rel=1e-15)
    g = teg.function("g", [x], teg.integral(x, (x, 0, x)))  # a bound is outside of the scope: this is x²/2
    assert teg.evaluate(g(t), {t: 3.0}) == pytest.approx(4.5, rel=1e-15)
    h = teg.function("h", [teg.param("x")], teg.integral(x + teg.param("x"), (x, 0, 1)))
    assert teg.evaluate(h(t), {t: 3.0}) == pytest.approx(3.5, rel=1e-15)


# -- what it means -------------------------------------------------------------------------------------------------------

BODIES: dict[str, Expr] = {
    "linear": 2 * u - 3 * v + k,
    "quadratic": u * v + k * u * u,
    "cubic": u * u * v - k,
    "waves": WAVE,
    "a root": teg.sqrt(1 + u * u) + teg.log(2 + v * v * k),
    "a kink": teg.abs(u - v) * k,
    "a jump": teg.bracket(u < k) * v,
    "a step": teg.floor(3 * u) + v,
    "an integral": teg.integral(teg.bracket(z * v < u) * k * z, (z, 0, 1)),
    "a quotient": k / (0.2 + u) + v,
    "a peak": teg.exp(-40 * (u - 0.5) ** 2) * v,
}
SCENES: dict[str, Callable[[Function], Expr]] = {
    "in front": lambda f: f(t, a) ** 2,
    "an integrand": lambda f: teg.integral(f(x, t) * teg.bracket(x < t), (x, 0, 1)),
    "two variables": lambda f: teg.integral(f(x, y) * teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1)),
    "a condition": lambda f: teg.integral(teg.bracket(f(x, 2.0) < t), (x, 0, 1)),
    "a bound": lambda f: teg.integral(x * teg.bracket(x < a), (x, 0, f(t, a))),
    "of a bracket": lambda f: teg.integral(f(teg.bracket(x < t), teg.where(x < a, x, 0.3)), (x, 0, 1)),
    "of itself": lambda f: teg.integral(f(f(x, t), a) * teg.bracket(x < t), (x, 0, 1)),
    "a divisor": lambda f: teg.integral(1 / (2 + f(x, t) ** 2), (x, 0, 1)),
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("body", BODIES)
def test_an_application_means_its_body(body: str, scene: str) -> None:
    if body == "an integral" and scene in ("of itself", "a condition"):
        pytest.skip("an integral in a condition on its own variable")
    linked = SCENES[scene](teg.function("f", [u, v], BODIES[body]))
    plain = SCENES[scene](teg.function("f", [u, v], BODIES[body], inline=True))
    f, g = (teg.compile(e, [t, k, a], inaccurate="ignore") for e in (linked, plain))
    values, gradients = zip(*(h.value_and_grad(AT) for h in (f, g)), strict=True)
    assert values[0] == pytest.approx(values[1], rel=1e-9, abs=1e-11)
    for name, expected in gradients[1].items():
        assert gradients[0][name] == pytest.approx(expected, rel=1e-8, abs=1e-10), name


@pytest.mark.parametrize("body", ["quadratic", "waves", "a root"])
def test_second_derivatives_and_products_with_them(body: str) -> None:
    linked, plain = (SCENES["an integrand"](teg.function("f", [u, v], BODIES[body], inline=i)) for i in (None, True))
    f, g = (teg.compile(e, [t, k]) for e in (linked, plain))
    at = {n: AT[n] for n in ("t", "k")}
    hessians = f.hessian(at), g.hessian(at)
    for pair, expected in hessians[1].items():
        assert hessians[0][pair] == pytest.approx(expected, rel=1e-12, abs=1e-13)
    product = f.hvp(at, {"t": 1.0, "k": 0.5})
    assert product["t"] == pytest.approx(hessians[1]["t", "t"] + 0.5 * hessians[1]["t", "k"], rel=1e-12)


def test_derivatives_are_symbolic_and_compile() -> None:
    d = teg.diff(teg.integral(wave()(x, t) * teg.bracket(x < t), (x, 0, 1)), t)
    assert any(isinstance(n, Apply) and n.derivative == (0, 1, 0) for n in _nodes(d))
    plain = teg.diff(teg.integral(wave(inline=True)(x, t) * teg.bracket(x < t), (x, 0, 1)), t)
    assert teg.evaluate(d, AT) == pytest.approx(float(teg.evaluate(plain, AT)), rel=1e-14)
    assert teg.jvp(wave()(t, a), {t: 1.0}) is teg.diff(wave()(t, a), t)


def test_every_derivative_of_a_body_is_taken_once(monkeypatch: pytest.MonkeyPatch) -> None:
    f = teg.function("once", [u, v], teg.sin(u * v) * teg.cos(u))
    calls: list[object] = []
    real = teg.analysis.bodies.slope
    monkeypatch.setattr(teg.analysis.bodies, "slope", lambda e, by: (calls.append(by), real(e, by))[1])
    e = teg.integral(f(x, t) * f(x * x, t) * teg.bracket(x < t), (x, 0, 1))
    teg.compile(e, [t]).hessian(t=0.5)
    teg.compile(e + 1, [t]).hessian(t=0.5)
    assert len(calls) == 3  # ∂₂, ∂₂∂₂, and ∂₁ on the surface


def test_a_function_can_apply_others() -> None:
    inner = teg.function("inner", [u], teg.sin(u) + k)
    outer = teg.function("outer", [u, v], inner(u * v) * inner(u) - v)
    e = teg.integral(outer(x, t) * teg.bracket(x < t), (x, 0, 1))
    f, g = teg.compile(e, [t, k]), teg.compile(write_all_out(e), [t, k])
    assert reasons(e) == {outer(x, t): ""}
    at = {"t": 0.6, "k": 0.3}
    assert f(at) == pytest.approx(float(g(at)), rel=1e-14)
    for pair, expected in g.hessian(at).items():
        assert f.hessian(at)[pair] == pytest.approx(expected, rel=1e-12)


def test_errors_of_results_pass_through_functions() -> None:
    inner = teg.integral(teg.exp(teg.sin(7 * x)), (x, 0, t))
    linked, plain = (teg.compile(wave(inline=i)(inner, t), [t, k]) for i in (None, True))
    at = {"t": 0.6, "k": 0.3}
    errors = linked.value_and_error(at)[1], plain.value_and_error(at)[1]
    assert 0 < errors[0] < 10 * errors[1]
    assert errors[1] < 10 * errors[0]
    assert linked.grad_and_error(at)[1]["t"] > 0


def test_arrays_are_arguments_only() -> None:
    V, i = teg.array("V", 2), teg.index("i")
    total = teg.sum(wave()(V[i, 0], V[i, 1]), (i, 0, teg.length(V, 0)))
    values = np.random.default_rng(1).uniform(0.2, 0.8, (5, 2))
    value, gradient = teg.compile(total).value_and_grad(V=values, k=0.3)
    p, q = values.T
    assert value == pytest.approx(float((np.sin(p) * q + 0.3 / (1 + p * p)).sum()), rel=1e-14)
    np.testing.assert_allclose(gradient["V"][:, 1], np.sin(p), rtol=1e-13)


def test_a_map_may_apply_a_function() -> None:
    r, s = teg.vars("r s")
    shift = teg.function("shift", [u], teg.sin(u) / 2)
    m = teg.Diffeomorphism({x: r - shift(s), y: s}, inverse={r: x + shift(y), s: y})
    e = teg.integral(teg.bracket(x + shift(y) < t), (x, -1, 1), (y, 0, 1))
    f = teg.compile(e, [t], maps=[m])
    assert f.grad(t=0.3)["t"] == pytest.approx(float(teg.compile(e, [t]).grad(t=0.3)["t"]), rel=1e-12)


# -- when it is written out ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "word"),
    [
        (WAVE, ""),
        (u * v + u**3, ""),
        (teg.sqrt(1 + u * u) * teg.log(teg.exp(u) + 2), ""),
        (u / k + teg.sqrt(k) + teg.log(k) * v, ""),
        (teg.atan(u) + teg.tanh(v) + teg.cosh(u), ""),
        (1 / u, "divide"),
        (teg.sqrt(u), "sqrt"),
        (teg.log(1 + u), "log"),
        (u**v, "pow"),
        (teg.tan(u), "tan"),
        (teg.asin(u), "asin"),
        (teg.atan2(u, v), "atan2"),
        (teg.abs(u), "condition"),
        (teg.maximum(u, v), "condition"),
        (teg.bracket(u < v), "condition"),
        (teg.floor(u), "steps"),
        (teg.mod(u, 2), "steps"),
        (teg.integral(x * u, (x, 0, 1)), "integral"),
        (teg.function("inner", [u], 1 / u)(v), "applies inner"),
    ],
)
def test_smooth_bodies_are_compiled_by_themselves(body: Expr, word: str) -> None:
    f = teg.function("f", [u, v], body)
    assert (word in f.obstacle) if word else f.obstacle == ""
    assert teg.function("f", [u, v], body, inline=False).obstacle == ""
    assert teg.function("f", [u, v], body, inline=True).obstacle == "inline=True"


def test_where_a_pass_has_to_look_it_is_written_out() -> None:
    f = wave()
    everywhere = f(x, t) * teg.bracket(f(x, 1.0) < t) + 1 / (2 + f(x, 2.0)) + teg.floor(f(x, 3.0)) + teg.sqrt(f(x, 4.0))
    e = teg.integral(everywhere, (x, 0, f(t, 5.0)))
    found = {n.children[1]: why for n, why in reasons(e).items()}
    places = ["", "a condition", "a divisor", "an argument of floor", "an argument of sqrt", "a bound"]
    assert [found[c].removeprefix("it stands in ") for c in (t, *map(teg.ir.expr.const, (1.0, 2.0, 3.0, 4.0, 5.0)))] == places
    left = write_out(e)
    assert [n for n in _nodes(left) if isinstance(n, Apply)] == [f(x, t)]
    assert write_out(left) is left


def test_narrow_peaks_and_tails_are_written_out() -> None:
    peak = teg.function("peak", [u], teg.exp(-(u**2) * k))
    fall = teg.function("fall", [u], teg.exp(-u))
    assert set(reasons(teg.integral(peak(x), (x, 0, 1))).values()) == {PEAKED}
    assert set(reasons(teg.integral(fall(x), (x, 0, 1))).values()) == {""}
    assert set(reasons(teg.integral(fall(x * x), (x, 0, 1))).values()) == {STEEP}
    assert "infinite" in next(iter(reasons(teg.integral(fall(x), (x, 0, np.inf))).values()))
    narrow = teg.compile(teg.integral(peak(x - 0.3), (x, 0, 1)))
    assert narrow(k=1e8) == pytest.approx(np.sqrt(np.pi / 1e8), rel=1e-9)
    assert teg.evaluate(teg.integral(fall(x / t), (x, 0, np.inf)), {t: 50.0}) == pytest.approx(50.0, rel=1e-9)


def test_of_a_peak_the_exponential_alone_is_written_out() -> None:
    spots = [
        teg.function("spot", [u, v], (1 + u) * teg.exp(-k * ((u - 0.3) ** 2 + (v - 0.2) ** 2)) + teg.sin(v)),
        teg.function("other spot", [u, v], teg.cos(u) * teg.exp(-k * (u * u + u * v + v * v) + u)),
    ]
    scenes = [teg.integral(f(x, y) * teg.bracket(x + a * y < t), (x, -1, 1), (y, -1, 1)) for f in spots]
    for e in scenes:
        outside = write_out(e)
        assert len([n for n in _nodes(outside) if isinstance(n, Apply)]) == 2
        assert reasons(outside).keys() == {n for n in _nodes(outside) if isinstance(n, Apply)}
        f, g = teg.compile(e, [t, k]), teg.compile(e, [t, k], functions="inlined")
        for sharp in (2.0, 300.0, 1e6):
            at = {"t": 0.6, "a": 0.5, "k": sharp}
            for name, expected in g.grad(at).items():
                assert f.grad(at)[name] == pytest.approx(expected, rel=1e-9, abs=1e-14)
    assert len({with_slots(write_out(e))[0] for e in scenes}) == 1
    d = teg.diff(spots[0](t, a), t)
    assert teg.evaluate(teg.integral(teg.diff(spots[0](t, a), t) * x, (x, 0, 1)), AT) == pytest.approx(0.5 * teg.evaluate(d, AT), rel=1e-14)


def test_a_promise_is_kept() -> None:
    smooth = teg.function("sinc", [u], teg.where(teg.abs(u) > 1e-8, teg.sin(u) / u, 1.0), inline=False)
    e = teg.integral(smooth(x), (x, 0, t))
    assert reasons(e) == {smooth(x): ""}
    f = teg.compile(e)
    assert f(t=1.0) == pytest.approx(0.9460830703671830, rel=1e-13)
    assert f.grad(t=1.0)["t"] == pytest.approx(np.sin(1.0), rel=1e-14)


def test_slots_and_back() -> None:
    f, g = wave(), teg.function("g", [u], u * u)
    e = teg.integral(f(x, t) * g(x) + f(t, x), (x, 0, 1))
    abstract, functions = with_slots(e)
    assert functions == (f, g)
    assert without_slots(abstract, functions) is e
    other, _ = with_slots(teg.integral(wave()(x, t) * teg.function("h", [v], 3 - v)(x) + wave()(t, x), (x, 0, 1)))
    assert other is abstract


# -- what is known of it -------------------------------------------------------------------------------------------------


def test_polynomials_are_integrated_exactly() -> None:
    shade = teg.function("shade", [u, v], k + u * v - u * u)
    assert Shadow((x,)).degree(shade(x, x)) == 2
    assert Shadow((x,)).degree(shade(x * x, t)) == 4
    assert Shadow((x,)).degree(wave()(x, t)) is None
    assert Shadow((x,)).degree(wave()(a, t)) == 0
    data = teg.explain(teg.integral(shade(x, x) ** 2 * teg.bracket(x < t), (x, 0, 1))).data
    assert [row["rule"] for row in data["integrals"]] == ["Gauss, exact"]
    assert data["functions"] == [{"function": "shade(u, v)", "applications": 1, "written out": 0, "why": ""}]


def test_different_functions_are_different_to_the_finite_field() -> None:
    f, g = wave(), teg.function("g", [u, v], u * v)
    point = Point("salt")
    assert point.value(f(t, a)) == point.value(f(t, a))
    assert point.value(f(t, a)) != point.value(f(a, t))
    assert point.value(f(t, a)) != point.value(g(t, a))
    assert point.value(g(t, a) - g(t, a + 0 * t)) == 0


def test_a_kink_between_equal_functions_has_no_delta() -> None:
    f = wave()
    d = teg.diff(teg.integral(teg.where(x < t, f(x, t), f(t, x)), (x, 0, 1)), t)
    assert not d.has_delta


def test_bodies_of_derivatives() -> None:
    variables, body = body_of(teg.function("f", [u, v], u * u * v), (1, 0))
    assert str(body) == "2·u·v"
    assert [w.name for w in variables] == ["u", "v"]


# -- how it prints -------------------------------------------------------------------------------------------------------


def test_it_prints() -> None:
    f = wave()
    assert str(f) == "wave(u, v) = sin(u)·v + k/(u² + 1)"
    assert str(f(x, t) + 1) == "wave(x, t; k) + 1"
    assert "∂₂wave(t, t; k)" in str(teg.diff(f(t, t), t))
    assert teg.latex(f(x, t)) == r"\mathrm{wave}\left(x, t;\, k\right)"
    assert r"\partial_{1} \mathrm{wave}" in teg.latex(teg.diff(f(t, a), t))
    assert "wave(x, t, k)" in teg.dump(f(x, t))
    assert teg.size(f(x, t)) == 4
    assert "wave" in repr(f)
    assert "it has a condition" in str(teg.explain(teg.function("h", [u], teg.abs(u))(t)))


def test_sympy_gets_it_written_out() -> None:
    sympy = pytest.importorskip("sympy")
    s = teg.to_sympy(wave()(t, a))
    assert sympy.simplify(s - teg.to_sympy(wave(inline=True)(t, a))) == 0
    assert "wave" not in str(s)


def test_odd_names_are_harmless() -> None:
    for name in ("x; rm -rf /", "int", "sin", "floor", "λ", "n" * 10_000, '"""', "{}"):
        f = teg.compile(teg.integral(teg.function(name, [u], teg.sin(u) * k)(x), (x, 0, t)))
        assert f(t=1.0, k=2.0) == pytest.approx(2 * (1 - np.cos(1.0)), rel=1e-14)
        assert f.grad(t=1.0, k=2.0)["t"] == pytest.approx(2 * np.sin(1.0), rel=1e-14)


def test_long_chains_do_not_overflow() -> None:
    e: Expr = t
    f = teg.function("f", [u], teg.sin(u))
    for _ in range(8_000):
        e = f(e)
    assert teg.size(write_out(e)) == 8_001
    assert teg.size(with_slots(e)[0]) == 8_001
    assert 0 < teg.evaluate(e, {t: 1.0}) < 0.03


def _nodes(e: Expr) -> list[object]:
    return list(teg.ir.node.postorder([e]))
