"""The language: interning, immutability, what is simplified on the way, and what misuse raises."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

import numpy as np
import pytest

import teg
from teg import errors
from teg.ir.expr import FALSE, ONE, TRUE, ZERO, Add, Call, Compare, Const, Mul, Not, Pow, Where, const
from teg.ir.integral import Delta, Integral, integral_over
from teg.ir.simplify import add, div, mul, power, sub, where
from teg.ir.traverse import parameters

x, y = teg.vars("x y")
t, a = teg.params("t a")


# -- interning and immutability -----------------------------------------------------------------------------------------


def test_equal_expressions_are_one_object() -> None:
    assert teg.var("x") is x
    assert teg.param("t") is t
    assert x + t * 2 is x + t * 2
    assert teg.integral(teg.bracket(x < t), (x, 0, 1)) is teg.integral(teg.bracket(x < t), (x, 0, 1))
    assert const(-0.0) is const(0.0)
    assert len({x + t, x + t, t + x}) == 2


def test_a_variable_and_a_parameter_of_one_name_are_two_things() -> None:
    assert teg.var("t") is not t


def test_copies_are_the_same_object() -> None:
    e = x + t
    assert copy.copy(e) is e
    assert copy.deepcopy([e])[0] is e


@pytest.mark.parametrize("attribute", ["data", "children", "name", "new"])
def test_expressions_are_immutable(attribute: str) -> None:
    with pytest.raises(AttributeError):
        setattr(x + t, attribute, 1)


def test_free_variables() -> None:
    assert (x * y + t).free == {x, y}
    assert teg.integral(x * y, (x, 0, y)).free == {y}
    assert teg.integral(x * y, (x, 0, x)).free == {x, y}  # a bound is outside of its own variable's scope


# -- simplification -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (x + 0, x),
        (x * 1, x),
        (mul(x, ZERO), ZERO),
        (sub(x, x), ZERO),
        (div(x, x), ONE),
        (x + x, 2 * x),
        (2 * x + 3 * x, 5 * x),
        (x * x, x**2),
        (power(x, ZERO), ONE),
        (x**1, x),
        ((x**2) ** 3, x**6),
        (x**0.5, teg.sqrt(x)),
        (x * t * 2 * 3, 6 * x * t),
        (-(-x), x),  # noqa: B002
        (+x, x),
        (const(2) + 3, const(5)),
        (teg.cos(0), ONE),
        (where(x < t, a, a), a),
        (teg.bracket(x < t) * teg.bracket(x < t), teg.bracket(x < t)),
        (teg.bracket(x < t) ** 3, teg.bracket(x < t)),
        (mul(teg.bracket(x < t), teg.bracket(~(x < t))), ZERO),
        (a * teg.bracket(x < t), teg.where(x < t, a, 0)),
        (teg.integral(0, (x, 0, 1)), ZERO),
        (integral_over(x, x, t, t), ZERO),
        (teg.delta(const(2)), ZERO),
        (teg.abs(const(-3)), const(3)),
        (teg.minimum(2, 3), const(2)),
        (teg.sign(const(-3)), const(-1)),
        (teg.where(x < t, teg.where((x < t) | (x < a), a, x), 0), a * teg.bracket(x < t)),
        (mul(teg.exp(div(a, ZERO)), div(x, ZERO)), teg.exp(div(a, ZERO)) * x),  # the limit: no power of 0 outweighs it
        (mul(power(ZERO, a), power(ZERO, const(-2))), power(ZERO, a - 2)),
    ],
    ids=lambda e: str(e),
)
def test_simplification(found: teg.Expr, expected: teg.Expr) -> None:
    assert found is expected


def test_conditions_simplify() -> None:
    c = x < t
    assert ~~c is c
    assert c & c is c
    assert c & ~c is FALSE
    assert c | ~c is TRUE
    assert c & (const(0) < const(1)) is c
    assert (const(1) < const(0)) is FALSE
    assert (const(1) <= const(1)) is TRUE
    assert (const(1) < const(1)) is FALSE


def test_reflected_comparisons_are_one_atom() -> None:
    assert (x < t) is (t > x)
    assert (x <= t) is (t >= x)
    assert (0.5 < x) is (x > 0.5)  # noqa: SIM300
    assert (x < t) is not (x <= t)


@pytest.mark.parametrize(
    "e", [t * 0, t - t, t / t, t**0, 1 + 0 * t, teg.where(x < t, a, a), teg.integral(x, (x, t, t)), teg.bracket(t < t)]
)
def test_what_was_written_is_not_forgotten(e: teg.Expr) -> None:
    """A parameter that simplification removes is still an argument of the program."""
    assert t in parameters(e)


def test_node_classes() -> None:
    assert isinstance(x + t, Add)
    assert isinstance(x * t, Mul)
    assert isinstance(x**3, Pow)
    assert isinstance(x**t, Call)
    assert isinstance(x / t, Mul)
    assert isinstance(x < t, Compare)
    assert isinstance(~(x < t), Not)
    assert isinstance(teg.abs(x), Where)
    assert isinstance(teg.integral(x, (x, 0, 1)), Integral)
    assert isinstance(teg.delta(x), Delta)
    assert isinstance(add(const(0.5), ZERO), Const)


def test_a_singular_function_goes_into_the_branches() -> None:
    e = teg.sqrt(teg.where(x < t, a, 0))
    assert isinstance(e, Where)
    assert e.then is teg.sqrt(a)
    assert e.otherwise is ZERO


def test_nested_domains_are_innermost_first() -> None:
    e = teg.integral(x * y, (x, 0, y), (y, 0, 1))
    assert isinstance(e, Integral)
    assert e.var is y
    assert isinstance(e.body, Integral)
    assert e.body.var is x
    assert e.body.hi is y


def test_numpy_scalars_on_either_side() -> None:
    two = np.float64(2.0)
    assert two * x is x * two is 2 * x
    assert two + x is 2 + x
    assert two - x is 2 - x
    assert two / x is 2 / x
    assert two**x is 2**x
    assert (two < x) is (x > 2)
    assert (np.float32(0.5) <= x) is (x >= 0.5)
    assert np.int64(3) * x is 3 * x
    assert np.array(2.0) * x is 2 * x


def test_tuples() -> None:
    e = teg.tuple(x, t * 2, (a, 1))
    assert len(e) == 3
    assert e[0] is x
    assert e[-2] is 2 * t
    assert next(iter(e)) is x
    assert teg.integral(teg.tuple(x, 2 * x), (x, 0, 1))[1] is teg.integral(2 * x, (x, 0, 1))


def test_capture_is_avoided() -> None:
    inner = teg.integral(y, (y, 0, x))  # ½x²
    outer = teg.integral(inner, (x, 0, teg.integral(y * t, (y, 0, 1))))  # ∫₀^{t/2} ½x² dx
    assert teg.evaluate(outer, {t: 2.0}) == pytest.approx(1 / 6, abs=1e-15)
    twice = teg.integral(teg.integral(x * x, (x, 0, x)), (x, 0, 1))
    assert teg.evaluate(twice) == pytest.approx(1 / 12, abs=1e-15)


# -- misuse -------------------------------------------------------------------------------------------------------------


def test_if_on_a_condition() -> None:
    with pytest.raises(errors.ConditionError) as caught:
        bool(x < t)
    assert caught.value.where is (x < t)
    assert "&" in caught.value.hint
    assert "where" in caught.value.hint


def test_a_chained_comparison() -> None:
    with pytest.raises(errors.ConditionError) as caught:
        a < x < t  # noqa: B015
    assert caught.value.where is (a < x)
    assert "(a < x) & (x < b)" in caught.value.hint


def test_a_comparison_of_a_comparison() -> None:
    with pytest.raises(errors.ConditionError):
        (a < x) < t  # noqa: B015
    with pytest.raises(errors.ConditionError) as caught:
        t < (a < x)  # noqa: B015
    assert caught.value.where is (a < x)


@pytest.mark.parametrize("make", [lambda: (x < t) and (x < a), lambda: (x < t) or (x < a), lambda: not (x < t)])
def test_python_logic_on_conditions(make: object) -> None:
    with pytest.raises(errors.ConditionError):
        make()  # type: ignore[operator]


def test_an_equality_is_a_truth_value_of_python() -> None:
    with pytest.raises(errors.ConditionError) as caught:
        teg.bracket(x == t)
    assert caught.value.where is None
    assert "identity" in caught.value.hint


@pytest.mark.parametrize("wrong", [1, 0.5, x, "x < t", None])
def test_a_bracket_of_no_condition(wrong: object) -> None:
    with pytest.raises(errors.ConditionError) as caught:
        teg.bracket(wrong)
    assert caught.value.where is wrong


@pytest.mark.parametrize(
    "operate", [lambda c: c + 1, lambda c: 2 * c, lambda c: -c, lambda c: c**2, abs, lambda c: x - c, lambda c: teg.sin(c)]
)
def test_arithmetic_on_a_condition(operate: object) -> None:
    with pytest.raises(errors.ConditionError) as caught:
        operate(x < t)  # type: ignore[operator]
    assert caught.value.where is (x < t)
    assert "bracket" in caught.value.hint


@pytest.mark.parametrize("operate", [lambda: x & (x < t), lambda: x | t, lambda: ~x, lambda: 1 & x])
def test_logic_on_numbers(operate: object) -> None:
    with pytest.raises(errors.ConditionError):
        operate()  # type: ignore[operator]


def test_an_expression_has_no_truth_value_and_is_no_number() -> None:
    with pytest.raises(errors.ConditionError) as caught:
        bool(x)
    assert caught.value.where is x
    with pytest.raises(errors.OperandError):
        float(x)
    with pytest.raises(errors.OperandError):
        math.sin(x)
    assert float(const(2)) == 2.0


def test_python_rounds_expressions_to_integers_only() -> None:
    assert round(x) is teg.round(x)
    assert math.floor(x) is teg.floor(x)
    assert math.ceil(x) is teg.ceil(x)
    assert (round(const(2.5)), round(const(3.5)), math.ceil(const(-0.5))) == (const(2), const(4), const(0))
    with pytest.raises(errors.OperandError) as caught:
        round(x, 2)
    assert caught.value.where is x
    assert "teg.round" in caught.value.hint


@pytest.mark.parametrize("wrong", ["1", None, [1, 2], 1j, np.array([1.0, 2.0]), object()])
def test_operands_that_are_none(wrong: object) -> None:
    with pytest.raises(errors.OperandError):
        x + wrong
    with pytest.raises(errors.OperandError):
        wrong * x


@pytest.mark.parametrize("wrong", [True, False])
def test_a_truth_value_is_not_a_number(wrong: bool) -> None:
    with pytest.raises(errors.ConditionError):
        x + wrong


def test_arithmetic_and_functions_of_tuples_are_entry_by_entry() -> None:
    e, f = teg.tuple(x, (t, a)), teg.tuple(2, (x, t))
    assert e + 1 is teg.tuple(x + 1, (t + 1, a + 1))
    assert 2 * e is teg.tuple(2 * x, (2 * t, 2 * a))
    assert e * f is teg.tuple(x * 2, (t * x, a * t))
    assert 1 / (-e) is teg.tuple(1 / (-x), (1 / (-t), 1 / (-a)))
    assert e**2 - f is teg.tuple(x**2 - 2, (t**2 - x, a**2 - t))
    assert (e // 2, 2 % e) == (teg.tuple(x // 2, (t // 2, a // 2)), teg.tuple(2 % x, (2 % t, 2 % a)))
    assert teg.sin(e) is teg.tuple(teg.sin(x), (teg.sin(t), teg.sin(a)))
    assert teg.atan2(1, e) is teg.tuple(teg.atan2(1, x), (teg.atan2(1, t), teg.atan2(1, a)))
    assert (
        (abs(e), round(e)) == (teg.abs(e), teg.round(e)) == (teg.tuple(abs(x), (abs(t), abs(a))), teg.tuple(round(x), (round(t), round(a))))
    )
    assert teg.sign(e)[0] is teg.sign(x)
    assert teg.where(x < t, e, 0) is teg.tuple(teg.where(x < t, x, 0), (teg.where(x < t, t, 0), teg.where(x < t, a, 0)))
    assert teg.maximum(e, 0, f)[1][0] is teg.maximum(t, 0, x)
    assert teg.bracket(x < t) * e is teg.where(x < t, e, 0)


def test_what_tuples_do_not_do() -> None:
    e = teg.tuple(x, t)
    with pytest.raises(errors.ConditionError) as caught:
        e < 1  # noqa: B015
    assert caught.value.where is e
    for operate in (lambda: e + teg.tuple(1, 2, 3), lambda: teg.integral(x, (x, 0, e)), lambda: teg.delta(e), lambda: e - (1, 2)):
        with pytest.raises(errors.OperandError):
            operate()
    with pytest.raises(errors.OperandError):
        e["a"]
    with pytest.raises((errors.OperandError, IndexError)):
        e[2]


def test_only_tuples_are_indexed_and_iterated_over() -> None:
    with pytest.raises(errors.OperandError):
        x[0]
    with pytest.raises(errors.OperandError):
        list(x)


@pytest.mark.parametrize("domain", [(), (3,), ((x, 0),), ((t, 0, 1),), (("x", 0, 1),), ((x + 1, 0, 1),)])
def test_domains_that_are_none(domain: tuple[object, ...]) -> None:
    with pytest.raises(errors.ScopeError):
        teg.integral(x, *domain)  # type: ignore[arg-type]


def test_a_variable_outside_its_integral() -> None:
    with pytest.raises(errors.ScopeError) as caught:
        teg.compile(teg.integral(x * y, (x, 0, 1)), [])
    assert caught.value.where is teg.integral(x * y, (x, 0, 1))
    assert "y" in caught.value.hint
    with pytest.raises(errors.ScopeError):
        teg.compile(teg.integral(x, (x, 0, x)))


def test_one_name_for_a_parameter_and_a_variable() -> None:
    with pytest.raises(errors.NameClashError):
        teg.compile(teg.integral(x * teg.param("x"), (x, 0, 1)))
    with pytest.raises(errors.NameClashError):
        teg.vars("x y x")
    with pytest.raises(errors.NameClashError):
        teg.params("t t")


@pytest.mark.parametrize("wrong", [1, None, ["x"], ""])
def test_names_are_strings(wrong: object) -> None:
    with pytest.raises(errors.OperandError):
        teg.var(wrong)  # type: ignore[arg-type]
    with pytest.raises(errors.OperandError):
        teg.param(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", ["a b", "2x", "t-1", "t'", "x.y", " "])
def test_arguments_have_names_that_python_takes_as_keywords(wrong: str) -> None:
    for make in (teg.param, teg.array, teg.indices):
        with pytest.raises(errors.ParameterError):
            make(wrong)
    with pytest.raises(errors.ParameterError, match="params") if wrong == "a b" else pytest.raises(errors.ParameterError):
        teg.param(wrong)
    assert teg.param("λ").name == "λ"


@pytest.mark.parametrize(
    ("mistake", "kind", "hint"),
    [
        (lambda: teg.compile((t, a)), errors.OperandError, "teg.tuple"),  # type: ignore[arg-type]
        (lambda: teg.sum([t, a]), errors.OperandError, "sum(…)"),  # type: ignore[call-overload]
        (lambda: teg.maximum([t, a]), errors.OperandError, "star"),  # type: ignore[arg-type]
        (lambda: max(x, t), errors.ConditionError, "teg.maximum"),  # type: ignore[type-var]
        (lambda: min(x, 1), errors.ConditionError, "teg.minimum"),  # type: ignore[type-var]
        (lambda: teg.integral(x, (x, 0, 1), (x, 0, 2)), errors.ScopeError, "another variable"),
        (lambda: teg.integral(x, (x, None, 1)), errors.OperandError, "math.inf"),  # type: ignore[arg-type]
        (lambda: t ^ 2, errors.OperandError, "u**2"),  # type: ignore[operator]
        (lambda: 2 ^ t, errors.OperandError, "u**2"),  # type: ignore[operator]
        (lambda: (t < a) ^ (t > 0), errors.ConditionError, "(c & ~d) | (~c & d)"),  # type: ignore[operator]
        (lambda: f"{t * t:.3f}", errors.OperandError, "teg.evaluate"),
        (lambda: teg.integral(lambda x: x, (x, 0, 1)), errors.OperandError, "call it"),  # type: ignore[call-overload]
        (lambda: teg.diff(teg.compile(t * t), t), errors.OperandError, "f.expression"),  # type: ignore[call-overload]
        (lambda: teg.prod([t, a]), errors.OperandError, "math.prod"),  # type: ignore[call-overload]
        (lambda: teg.any([t < a]), errors.OperandError, "c | d"),  # type: ignore[arg-type]
        (lambda: teg.all([t < a]), errors.OperandError, "c & d"),  # type: ignore[arg-type]
    ],
)
def test_hints_name_what_to_write(mistake: Callable[[], object], kind: type[errors.TegError], hint: str) -> None:
    with pytest.raises(kind) as caught:
        mistake()
    assert hint in caught.value.hint


@pytest.mark.parametrize("wrong", [x, 3, "t", [x], x + t, [t, t]])
def test_one_differentiates_by_parameters_and_free_variables(wrong: object) -> None:
    with pytest.raises((errors.ParameterError, errors.ScopeError)):
        teg.grad(teg.integral(x * t, (x, 0, 1)), wrong)  # type: ignore[arg-type]


def test_a_delta_in_a_nonlinear_place() -> None:
    with pytest.raises(errors.DeltaError):
        teg.sin(teg.delta(x - t))
    with pytest.raises(errors.DeltaError):
        teg.bracket(teg.delta(x - t) < 1)
    with pytest.raises(errors.DeltaError):
        teg.eliminate(teg.integral(teg.delta(x - t) ** 2, (x, 0, 1)))
    with pytest.raises(errors.DeltaError):
        teg.evaluate(teg.delta(t), {t: 0.0})


def test_every_error_prints_where_and_a_hint_and_pickles() -> None:
    import pickle

    with pytest.raises(errors.TegError) as caught:
        bool(x < t)
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is errors.ConditionError
    assert (again.what, again.where, again.hint) == (caught.value.what, caught.value.where, caught.value.hint)
    assert str(x < t) in str(again)
    assert again.hint in str(again)


def test_errors_below_the_exceptions_python_users_expect() -> None:
    assert issubclass(errors.OperandError, TypeError)
    assert issubclass(errors.ConditionError, TypeError)
    assert issubclass(errors.ParameterError, ValueError)
    assert issubclass(errors.OptionError, ValueError)
    assert issubclass(errors.MissingPackageError, ImportError)
    for name in dir(errors):
        thing = getattr(errors, name)
        if isinstance(thing, type) and issubclass(thing, Exception):
            assert issubclass(thing, teg.TegError)


@pytest.mark.parametrize(
    ("mistake", "hint"),
    [
        (lambda: math.exp(-x), "teg.exp for math.exp"),
        (lambda: (t * t)(t=0.5), "teg.evaluate(e, t=0.5)"),
        (lambda: max(x, t), "teg.minimum, teg.maximum for Python's min, max"),
        (lambda: teg.integral(x, (0, 1, x)), "the variable comes first: (x, lower, upper)"),  # type: ignore[arg-type]
        (lambda: teg.integral(t, (t, 0, 1)), 't = teg.var("t")'),  # type: ignore[arg-type]
        (lambda: teg.compile(t * t, ["t"]), "teg.param('t')"),  # type: ignore[list-item]
        (lambda: teg.diff(t * t, "t"), "teg.param('t')"),  # type: ignore[call-overload]
    ],
)
def test_a_hint_shows_what_to_write(mistake: Callable[[], object], hint: str) -> None:
    with pytest.raises(errors.TegError) as caught:
        mistake()
    assert hint in caught.value.hint


@pytest.mark.parametrize("wrong", [lambda: x * 10**400, lambda: teg.size("x"), lambda: teg.latex(None)])
def test_what_is_no_expression_is_named(wrong: Callable[[], object]) -> None:
    with pytest.raises(teg.errors.OperandError) as caught:
        wrong()
    assert caught.value.hint


def test_multiples_of_a_branch_beside_another_one() -> None:
    """Branches on one condition are collected with what they are multiplied with."""
    one, other = teg.where(t < 2, 1, t), teg.where(t < 2, 0, a)
    assert add(other, one, -one) is other
    assert add(one, other, -0.5 * one) is teg.where(t < 2, 0.5, 0.5 * t + a)
    assert add(one, -1 * one, other, other) is teg.where(t < 2, 0, 2 * a)
    for terms in ((one, other, -3 * one), (other, -2 * other, one, one), (2 * one, one, -other, other)):
        for at in ({"t": 1.0, "a": 0.7}, {"t": 3.0, "a": 0.7}):
            assert teg.evaluate(add(*terms), at) == pytest.approx(sum(float(teg.evaluate(term, at)) for term in terms), rel=1e-15)
