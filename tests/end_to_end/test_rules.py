"""A rule that is asked for is the rule of every integral, of boundary terms too."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

import teg
from teg.program import Adaptive, Gauss, Hyperbola, Integrate, Midpoint, Polygon, Sample, Segment, Stmt

x, y = teg.vars("x y")
t, a = teg.params("t a")


def volume(condition: object, integrand: object = 1.0) -> teg.Expr:
    return teg.integral(teg.bracket(condition) * integrand, (x, 0, 1), (y, 0, 1))


FAMILIES = {
    "line": volume(x + a * y < t),
    "triangle": volume((x + a * y < t) & (y < x) & (y < t)),
    "bilinear": volume(x * y + a * x < t),
    "bilinear, a polynomial": volume(x * y + a * x < t, 1 + x * y),
    "disk": volume(x * x + a * y * y < t),
    "isolated": volume(x**4 + a * y**4 < t),
    "graph": volume(y < teg.exp(x) * a * t),
    "pole": teg.integral(a / (1 + t * x) ** 2, (x, 0, 1)),
}
OPTIONS = [("adaptive", None), ("auto", 9), ("gauss", 5), ("midpoint", 7), ("montecarlo", 64), ("qmc", 64)]


def inside(stmts: Iterable[Stmt]) -> list[Stmt]:
    """All statements that integrate, however deep."""
    found: list[Stmt] = []
    for s in stmts:
        if isinstance(s, Integrate | Sample | Polygon | Segment | Hyperbola):
            found.append(s)
        for block in ("flags", "setup", "scales", "body"):
            found += inside(getattr(s, block, ()))
    return found


@pytest.mark.parametrize("orders", [0, 1])
@pytest.mark.parametrize(("rule", "order"), OPTIONS)
@pytest.mark.parametrize("name", FAMILIES)
def test_the_rule_is_used_everywhere(name: str, rule: str, order: int | None, orders: int) -> None:
    program = teg.compile(FAMILIES[name], rule=rule, order=order, inaccurate="ignore").program(orders)
    found = inside(program.body)
    assert found
    for s in found:
        if rule in ("montecarlo", "qmc"):
            assert isinstance(s, Sample)
            assert (s.kind, s.count) == (rule, order)
            continue
        assert isinstance(s, Integrate)
        if rule == "midpoint":
            assert isinstance(s.rule, Midpoint)
            assert s.rule.nodes == order
        elif rule == "gauss":
            assert isinstance(s.rule, Gauss | Adaptive)
            assert (s.rule.order if isinstance(s.rule, Adaptive) else s.rule.nodes) <= 5
        else:
            assert isinstance(s.rule, Adaptive) or order is not None
            if isinstance(s.rule, Adaptive) and order is not None:
                assert s.rule.first == order


def test_closed_forms_where_no_rule_is_asked_for() -> None:
    kinds = {type(s) for name in ("line", "bilinear") for s in inside(teg.compile(FAMILIES[name]).program(1).body)}
    assert kinds == {Polygon, Segment, Hyperbola}


def test_what_other_rules_give_at_a_bilinear_surface() -> None:
    exact = teg.compile(FAMILIES["bilinear"]).grad(t=0.3, a=0.2)["t"]
    rough = teg.compile(FAMILIES["bilinear"], rule="midpoint", order=256, inaccurate="ignore").grad(t=0.3, a=0.2)["t"]
    assert rough != exact
    assert rough == pytest.approx(exact, rel=0.05)
    assert teg.compile(FAMILIES["bilinear"], rule="adaptive").grad(t=0.3, a=0.2)["t"] == pytest.approx(exact, rel=1e-10)


def test_the_explanation_promises_closed_forms_only_where_they_are() -> None:
    for options, there in (({}, True), ({"rule": "midpoint"}, False), ({"order": 9}, False), ({"intrinsics": False}, False)):
        report = teg.compile(FAMILIES["bilinear"], **options).explain()  # type: ignore[arg-type]
        (surface,) = report.data["surfaces"]
        assert ("closed form" in surface["treatment"]) is there
        assert ("closed form" in str(report)) is there
        assert bool(report.data["boundary"]) is not there


def test_the_rule_holds_in_sums_and_in_products_with_directions() -> None:
    corners, k = teg.array("V", 1), teg.index("k")
    e = teg.sum(volume(x * y + corners[k] * x < t), (k, 0, teg.length(corners, 0)))
    f = teg.compile(e, [corners], rule="midpoint", order=8, inaccurate="ignore")
    assert "Hyperbola" not in repr(f.program(1))
    g = teg.compile(FAMILIES["bilinear"], rule="adaptive")
    assert g.hvp({"t": 0.3, "a": 0.2}, {"t": 1.0})["t"] == pytest.approx(g.hessian(t=0.3, a=0.2)["t", "t"], rel=1e-8)
