"""What `explain` says: every surface, why some have no δ, the rules that the program has, and that it can be read."""

from __future__ import annotations

import json
from typing import Any

import pytest

import teg
from teg.analysis.surfaces import owned_surfaces
from teg.errors import OptionError
from teg.ir.expr import Expr
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.pipeline import normal_form
from teg.program import Gauss, Integrate, Rational, SumOver, statements
from teg.report.explanation import WIDTH, shortened
from tests.references import REFERENCES, Reference

x, y, z = teg.vars("x y z")
t, a, b, c = teg.params("t a b c")
NO_ROTATION = "x, y: over the one with the largest |slope|·extent"


def over(e: Any, *names: Any) -> Expr:
    """∫₀¹…∫₀¹ e, the first variable innermost."""
    return teg.integral(e, *((v, 0, 1) for v in names))


def only(entries: list[dict[str, Any]]) -> dict[str, Any]:
    (entry,) = entries
    return entry


def reasons(report: teg.Explanation) -> dict[str, str]:
    """Surface -> why it has no δ."""
    entries = [*report.data["surfaces"], *report.data["dropped"]]
    return {s["surface"]: s["treatment"] for s in entries if s["status"] != "eliminated"}


# -- every problem -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("problem", REFERENCES, ids=lambda r: r.id)
def test_every_reference(problem: Reference) -> None:
    e = problem.build()
    report = teg.explain(e, derivatives=1)
    data = json.loads(json.dumps(report.data))
    assert data == report.data
    assert max(len(line) for line in str(report).splitlines()) <= WIDTH
    assert "<table" in report._repr_html_()
    owned = {(g, n.var) for n in postorder([normal_form(e)]) if isinstance(n, Integral) for g in owned_surfaces(n.body, n.var)}
    assert sum(s["count"] for s in data["surfaces"]) == len({(g, v.name) for g, v in owned})
    for g, v in owned:
        assert any(s["surface"] == f"{g} = 0" and s["owner"] == f"∫ d{v.name}" for s in data["surfaces"] if s["count"] == 1)
    if not data["gradient_error"]:
        program = teg.compile(e).program(1)
        rows = [r for k in ("integrals", "boundary", "interior") for r in data[k]]
        said = {(r["rule"], r["nodes"]) for r in rows}
        sums = any(isinstance(s, SumOver) for s in statements(program.body))
        assert sums == any(r["isolated"] for r in rows if r["kind"] == "sum over roots")
        for s in statements(program.body):
            if isinstance(s, Integrate) and isinstance(s.rule, Gauss):
                assert said & {("Gauss, exact", s.rule.nodes), ("closed form", s.rule.nodes)}
            elif isinstance(s, Integrate) and isinstance(s.rule, Rational):
                assert any(rule == "Gauss with a pole, exact" and nodes <= s.rule.nodes for rule, nodes in said)
            elif isinstance(s, Integrate):
                assert (f"adaptive to {s.rule.tol:.0e}" + ", smooth ends" * s.rule.cubic, s.rule.first) in said
            if isinstance(s, Integrate):
                assert max(r["breaks"] for r in rows) >= len(s.breaks)


# -- families ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("condition", "family", "variables", "says"),
    [
        (x < t, "affine", ["x"], "affine in x"),
        (x + a * y < t, "affine", ["y", "x"], f"affine in {NO_ROTATION}"),
        (x * y + a * x < t, "bilinear", ["y", "x"], "over x where the curve is steeper in it, else over y"),
        (teg.exp(x) < t, "solved for one variable", ["x"], "over x (1 root, formula)"),
        (x * x < t, "quadratic in one variable", ["x"], "over x (2 roots, formula)"),
        (teg.sin(a * x) < t, "isolated at run time", ["x"], "over x (16 roots at first, isolated)"),
        (x * x + y * y < t, "an ellipse, by angle", ["y", "x"], "an ellipse, by angle around the curve in"),
        (x * x + a * y * y < t, "isolated at run time", ["y", "x"], "x (2 roots, formula) and y (2 roots, formula)"),
        (x * teg.exp(-x) < t, "isolated at run time", ["x"], "over x (≤ 2 roots, isolated)"),
        (y + x * x * y * y < t + teg.sin(x), "isolated at run time", ["y", "x"], "y (2 roots, formula)"),
    ],
)
def test_families(condition: Any, family: str, variables: list[str], says: str) -> None:
    surface = only(teg.explain(over(teg.bracket(condition), x, y)).data["surfaces"])
    assert (surface["status"], surface["family"], surface["variables"]) == ("eliminated", family, variables)
    assert says in surface["treatment"]
    assert surface["owner"] == "∫ dx"


def test_charts_tell_their_roots() -> None:
    heart = (x**2 + y**2 - 1) ** 3 - x**2 * y**3 < t
    surface = only(teg.explain(teg.integral(teg.bracket(heart), (x, -2, 2), (y, -2, 2))).data["surfaces"])
    assert surface["charts"] == [{"variable": v, "roots": 6, "how": "isolated", "beyond": False} for v in "xy"]
    assert surface["parameters"] == ["t"]


def test_curved_bounds_leave_one_variable() -> None:
    e = teg.integral(teg.bracket(x + a * y < t), (x, 0, y * y), (y, 0, 1))
    surface = only(teg.explain(e).data["surfaces"])
    assert surface["variables"] == ["x"]
    assert "bounds are curved" in surface["treatment"]
    straight = only(teg.explain(teg.integral(teg.bracket(x + a * y < t), (x, 0, y), (y, 0, 1))).data["surfaces"])
    assert straight["variables"] == ["y", "x"]


def test_steps_of_one_floor_stand_together() -> None:
    report = teg.explain(over(teg.floor(3 * x + t), x))
    surface = only(report.data["surfaces"])
    assert (surface["count"], surface["of"], surface["family"]) == (5, "floor(3·x + t)", "affine")
    assert "5 parallel surfaces of floor(3·x + t)" in str(report)
    several = teg.explain(over(teg.floor(x + t) * teg.bracket(x < a) * teg.floor(3 * x), x)).data["surfaces"]
    assert sorted(s["count"] for s in several) == [1, 2, 3]


def test_steps_that_are_too_many() -> None:
    report = teg.explain(over(teg.bracket(x * teg.floor(x * t) > a), x))
    assert "derivatives are NaN" in reasons(report)["x·floor(x·t) - a = 0"]


def test_the_programs_own_delta() -> None:
    report = teg.explain(over(teg.delta(x - t) * teg.exp(x), x))
    surface = only(report.data["surfaces"])
    assert (surface["surface"], surface["family"]) == ("x - t = 0", "affine")
    assert surface["treatment"].startswith("a δ of the program")
    assert report.data["integrals"] == []


def test_what_no_family_reduces() -> None:
    e = over(teg.delta(x * teg.mod(x, t) - a), x)
    report = teg.explain(e)
    assert report.data["value_error"]
    assert "No value" in str(report)


# -- no δ ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("e", "surface", "why"),
    [
        (over(teg.abs(x - t), x), "x - t = 0", "kink"),
        (over(teg.where(t > a, x, x * x), x), "t - a = 0", "parameters only"),
        (teg.integral(x * teg.bracket(x < t), (x, 0, t)), "t - x = 0", "the bound x = t decides it"),
        (over(teg.bracket(x < t) * teg.bracket(2 * x < 2 * t), x), "2·t - 2·x = 0", "identical to t - x = 0"),
        (over(t * teg.bracket(x < 0.5), x), "-x + 0.5 = 0", "does not move: no parameter in it"),
        (over(t * teg.bracket(teg.exp(x) > 0), x), "exp(x) = 0", "decided: it is the same everywhere"),
        (over(t * (teg.bracket(x < a) - teg.bracket(x < a)), x), "a - x = 0", "cancels"),
        (over(teg.bracket(sum(teg.abs(x - p) for p in (a, b, c)) < t), x), "x - a = 0", "a kink inside another surface"),
    ],
)
def test_what_was_dropped_and_why(e: Expr, surface: str, why: str) -> None:
    report = teg.explain(e)
    assert why in reasons(report)[surface]
    assert why.split(":")[0] in str(report)


def test_other_parameters_do_not_move_it() -> None:
    report = teg.explain(over(teg.bracket(x < t) * a, x), [a])
    assert "no parameter that is differentiated by" in reasons(report)["t - x = 0"]


# -- integrals and cost --------------------------------------------------------------------------------------------------


def test_breaks_and_how_they_are_found() -> None:
    lines = teg.explain(over(teg.bracket(x + a * y < t), x, y), rule="gauss").data["integrals"]
    assert [(i["variable"], i["formula"], i["isolated"], i["searched"], i["degree"], i["nodes"]) for i in lines] == [
        ("y", 2, 0, False, 1, 1),
        ("x", 1, 0, False, 0, 1),
    ]
    isolated = only(teg.explain(over(teg.bracket(x * teg.exp(-x) < t), x)).data["integrals"])
    assert (isolated["formula"], isolated["isolated"], isolated["pieces"]) == (0, 2, 3)
    searched = teg.explain(over(teg.bracket(x * teg.exp(x) + y * y * y * x < t), x, y)).data["integrals"][0]
    assert searched["searched"]
    assert "adaptive" in searched["rule"]


def test_boundary_and_interior_integrals() -> None:
    e = over(teg.bracket(x + y < t) * teg.exp(a * x), x, y)
    short, long = teg.explain(e), teg.explain(e, derivatives=1)
    assert [i["variable"] for i in short.data["boundary"]] == ["s"]
    assert short.data["interior"] == []
    assert {i["variable"] for i in long.data["interior"]} == {"x", "y"}
    assert "interior integrals" in str(long)
    assert "interior integrals" not in str(short)


def test_the_cost_counts_the_nodes_of_all_pieces() -> None:
    line = teg.explain(over(x**5 * teg.bracket(x < t), x)).data["cost"]["value"]
    assert line == {"statements": line["statements"], "integrals": 1, "isolations": 0, "evaluations": 2 * 3, "least": 3, "adaptive": False}
    clipped = teg.explain(over(x * teg.bracket(x + y < t), x, y)).data["cost"]["value"]
    assert (clipped["integrals"], clipped["evaluations"], clipped["least"]) == (1, 3, 1)  # 3 triangles of 1 node
    nested = teg.explain(over(teg.bracket(x + y < t), x, y), rule="gauss").data["cost"]["value"]
    assert (nested["evaluations"], nested["least"]) == (3 * 2, 1)  # 3 pieces of 1 node, in each 2 pieces of 1 node
    in_closed_form = teg.explain(over(teg.exp(x) * teg.bracket(x < t), x)).data["cost"]["value"]
    assert (in_closed_form["evaluations"], in_closed_form["adaptive"]) == (0, False)  # one interval has no nodes
    curved = teg.explain(over(teg.exp(x**3) * teg.bracket(x < t), x)).data["cost"]["value"]
    assert (curved["evaluations"], curved["least"], curved["adaptive"]) == (2 * 8, 8, True)


@pytest.mark.parametrize(
    ("e", "cheapest"),
    [
        (over(teg.bracket(x + a * y < t) * x**3, x, y), {"t": 0.5, "a": 1.0}),  # one triangle
        (over(teg.bracket(x + a * y < t) * teg.exp(teg.sin(x / 2)), x, y), {"t": 9.0, "a": 0.01}),  # covered
        (over(teg.bracket(x < t) * teg.bracket(x < a) * x**5, x), {"t": 0.5, "a": 2.0}),
        (teg.integral(teg.bracket(x * x + y * y < t), (x, -1, 1), (y, -1, 1)), {"t": 5.0}),
    ],
    ids=["polygon", "adaptive", "Gauss", "disk"],
)
def test_the_least_is_what_a_call_can_do_with(e: Expr, cheapest: dict[str, float]) -> None:
    f = teg.compile(e)
    assert f.evaluations(cheapest) == f.explain().data["cost"]["value"]["least"]


def test_the_statements_are_those_of_the_program() -> None:
    e = over(teg.bracket(x + a * y < t) * x, x, y)
    f = teg.compile(e, [t, a])
    data = f.explain().data
    for key, orders in (("value_statements", 0), ("gradient_statements", 1)):
        assert data[key] == len(list(statements(f.program(orders).body)))


# -- options -------------------------------------------------------------------------------------------------------------


def test_the_evaluators_options_count() -> None:
    e = over(teg.bracket(x + y < t) * x, x, y)
    assert "clipped polygon" in str(teg.compile(e).explain())
    assert "Gauss" in str(teg.compile(e, rule="gauss").explain())
    loose = teg.compile(e, tol=1e-4, rule="adaptive").explain()
    assert [i["rule"] for i in loose.data["integrals"]] == ["adaptive to 1e-04", "adaptive to 1e-05"]
    assert loose.data["options"] == {
        "tol": 1e-4,
        "rule": "adaptive",
        "order": None,
        "discontinuities": "exact",
        "max_roots": 16,
        "intrinsics": True,
    }
    plain = teg.compile(e, discontinuities="ignore").explain()
    assert only(plain.data["surfaces"])["status"] == "ignored"
    assert plain.data["boundary"] == []
    assert teg.compile(e, [t]).explain(derivatives=1).data["interior"] == []
    many = teg.compile(over(teg.bracket(teg.sin(a * x) < t * x), x), max_roots=40).explain()
    assert only(only(many.data["surfaces"])["charts"])["roots"] == 40
    assert only(many.data["integrals"])["isolated"] == 40


def test_maps_count() -> None:
    r, p = teg.vars("r p")
    e = teg.integral(teg.bracket(x * x + y * y < t), (x, -1, 1), (y, -1, 1))
    m = teg.polar(x, y, r, p)
    surface = only(teg.compile(e, maps=[m]).explain().data["surfaces"])
    assert surface["family"].startswith("mapped to r, p")
    assert "mapped to r, p" in str(teg.explain(e, maps=[m]))


def test_options_that_are_wrong() -> None:
    with pytest.raises(OptionError, match="derivatives=2"):
        teg.explain(over(x, x), derivatives=2)


# -- text ----------------------------------------------------------------------------------------------------------------


def test_the_whole_text() -> None:
    e = over(teg.bracket(x + a * y < t) * x * teg.bracket(x < 0.5), x, y)
    report = teg.explain(e)
    value, gradient = (str(report.data[k]).rjust(10) for k in ("value_statements", "gradient_statements"))
    assert str(report) == (
        "∫[y: 0..1] (∫[x: 0..1] [t - (x + a·y) > 0 & x < 0.5]·x)\n"
        "\n"
        "surfaces that move\n"
        "  surface            owner  how δ is eliminated\n"
        "  t - (x + a·y) = 0  ∫ dx   affine in x, y: over the one with the largest |slope|·extent\n"
        "\n"
        "no δ\n"
        "  surface       owner  why\n"
        "  -x + 0.5 = 0  ∫ dx   does not move: no parameter in it\n"
        "\n"
        "integrals of the value\n"
        "  over  from .. to  breaks  degree  rule             nodes a piece\n"
        "  y     0 .. 1      none         1  clipped polygon              1\n"
        "\n"
        "boundary integrals of the gradient\n"
        "  over  from .. to  breaks  degree  rule              nodes a piece\n"
        "  s     0 .. 1      none         1  clipped interval              1\n"
        "  s     0 .. 1      none         2  clipped interval              2\n"
        "\n"
        "cost of the expression of 20 nodes\n"
        "                      statements  integrals  integrand evaluations a call  least possible\n"
        f"  value               {value}          1                       about 4               1\n"
        f"  value and gradient  {gradient}          2                       about 6               3"
    )


def test_no_integral_and_no_surface() -> None:
    assert "There is no integral in the value." in str(teg.explain(t * a + 1))
    assert "There is no integral in the value." in str(teg.explain(3))
    assert "There is no surface" in str(teg.explain(over(x * t, x)))
    assert teg.explain(teg.tuple(t, over(x, x))).data["integrals"]


def test_many_surfaces_are_summed_up() -> None:
    ps = [teg.param(f"p{i}") for i in range(60)]
    report = teg.explain(over(sum(teg.bracket(x < p) for p in ps), x))
    assert len(report.data["surfaces"]) == 60
    assert len(str(report).splitlines()) < 40
    assert "44 more: affine" in str(report)


def test_long_expressions_are_shortened() -> None:
    e = x
    for _ in range(300):
        e = teg.sin(e) + t
    text = str(teg.explain(over(teg.bracket(e > 0) + e, x)))
    assert max(map(len, text.splitlines())) <= WIDTH
    assert "an expression of" in text
    assert shortened("0123456789" * 3, 20) == "012345678901 … 56789"
    assert shortened("short", 20) == "short"
