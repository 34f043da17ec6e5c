"""LaTeX of expressions."""

from __future__ import annotations

import pytest

import teg
import teg.ir.tables
from teg.ir.arrays import Placed, Ranged
from teg.ir.expr import FUNCTIONS
from teg.ir.function import Apply
from teg.ir.latex import latex
from teg.ir.node import Node
from teg.ir.simplify import call
from tests.references import REFERENCES, Reference

x, y = teg.vars("x y")
t, a, v00, height, theta = teg.params("t a v00 drop_height theta")


def is_balanced(text: str) -> bool:
    depth = 0
    for c in text.replace(r"\{", "").replace(r"\}", ""):
        depth += (c == "{") - (c == "}")
        if depth < 0:
            return False
    return depth == 0 and text.count(r"\left") - text.count(r"\leftarrow") == text.count(r"\right")


@pytest.mark.parametrize(
    ("e", "text"),
    [
        (x + t, "x + t"),
        (x - 2 * t, "x - 2 \\, t"),
        (2 * (x + t), "2 \\, \\left(x + t\\right)"),
        (x**3, "x^{3}"),
        ((x + 1) ** 2, "\\left(x + 1\\right)^{2}"),
        (x / t, "\\frac{x}{t}"),
        (1 / t, "\\frac{1}{t}"),
        (-x, "-x"),
        (x * t**-2, "\\frac{x}{t^{2}}"),
        (teg.sqrt(x + 1), "\\sqrt{x + 1}"),
        (x**t, "x^{t}"),
        (teg.sin(x), "\\sin\\left(x\\right)"),
        (teg.asin(x), "\\arcsin\\left(x\\right)"),
        (teg.bracket(x < t), "\\left[\\,x < t\\,\\right]"),
        (teg.bracket(x <= 2 * t), "\\left[\\,x \\leq 2 \\, t\\,\\right]"),
        (teg.bracket(x > 0) * a, "\\left[\\,0 < x\\,\\right] \\, a"),
        (teg.where(x < t, a, 2), "\\begin{cases} a & \\text{if } x < t \\\\ 2 & \\text{otherwise} \\end{cases}"),
        (teg.integral(x * x, (x, 0, t)), "\\int_{0}^{t} x^{2} \\,\\mathrm{d}x"),
        (teg.delta(x - t), "\\delta\\!\\left(x - t\\right)"),
        (teg.tuple(x, t), "\\left(x, t\\right)"),
        (v00 + theta, "v_{00} + \\theta"),
        (height * 1e-9, "10^{-9} \\, \\mathrm{drop\\_height}"),
        (x * 1.5e30, "1.5 \\cdot 10^{30} \\, x"),
        (x / (t + 1) ** 2 / a, "\\frac{x}{\\left(t + 1\\right)^{2} \\, a}"),
        (-teg.floor(x) / 3, "-\\frac{\\left\\lfloor x \\right\\rfloor}{3}"),
        (teg.mod(x, t), "\\operatorname{mod}\\left(x, t\\right)"),
        (teg.tuple(t), "\\left(t,\\right)"),
        (call("ceil", x), "\\left\\lceil x \\right\\rceil"),
        (call("root", x), "\\sqrt{x}"),
        (call("magnitude", x - t), "\\left|x - t\\right|"),
        (call("min", x, t), "\\min\\left(x, t\\right)"),
    ],
    ids=str,
)
def test_normal_form(e: teg.Expr, text: str) -> None:
    assert latex(e) == text


def test_every_function_has_a_form() -> None:
    for f in FUNCTIONS:
        e = call(f, x, t) if f in ("atan2", "mod", "pow", "min", "max") else call(f, x)
        assert is_balanced(latex(e))
        assert is_balanced(latex(1 / e**2 + e))


def test_every_node_has_a_form() -> None:
    leaves: set[type[Node]] = set()
    stack: list[type[Node]] = [teg.Expr, teg.Cond]
    while stack:
        kind = stack.pop()
        stack += kind.__subclasses__()
        leaves |= {kind} if not kind.__subclasses__() else set()
    children = {"Where": (x < t, x, t), "Integral": (x, t, t), "And": (x < t, t < a), "Or": (x < t, t < a), "Not": (x < t,)}
    data = {"Const": 0.5, "Truth": True, "Pow": 2, "Call": "sin", "Integral": x, "Param": "t", "Var": "x", "Compare": (True, None)}
    few = {"Const": 0, "Truth": 0, "Param": 0, "Var": 0, "Pow": 1, "Call": 1, "Delta": 1, "PointMasses": 1, "Compare": 1}
    v, k = teg.array("v", 2), teg.index("k")
    place = (v, (teg.indices("f")[k], k // 2))
    data |= {"Gather": place, "StillGather": place, "Still": "t", "Unit": place, "IndexValue": k % 3, "Sum": (k, k * 0, teg.length(v))}
    few |= {"Gather": 0, "StillGather": 0, "Still": 0, "Unit": 0, "IndexValue": 0, "Sum": 1}
    children["Nearest"] = (x, t, x < t, t)
    for kind in leaves - {Apply}:  # which needs a function's body
        name = kind.__name__
        parts = children.get(name, (x, t)[: few.get(name, 1 if issubclass(kind, Ranged | Placed) else 2)])
        if issubclass(kind, Placed):
            data[name] = (k % 3, 1)
        if issubclass(kind, Ranged):
            data[name] = (k, k * 0, teg.length(v), () if name == "Uncovered" else None)
        assert is_balanced(latex(kind.make(data.get(name), parts)))  # type: ignore[type-var]


def test_conditions() -> None:
    assert latex((x < t) & (x > a)) == "x < t \\wedge a < x"
    assert latex(~((x < t) | (x > a))) == "\\neg \\left(x < t \\vee a < x\\right)"


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda r: r.id)
def test_braces_are_balanced(reference: Reference) -> None:
    e = reference.build()
    assert is_balanced(latex(e))
    assert is_balanced(latex(teg.grad(e)))


def test_notebooks_show_it() -> None:
    assert (x + t)._repr_latex_() == "$x + t$"
    assert (x < t)._repr_latex_() == "$x < t$"


@pytest.mark.parametrize(
    "e", [x / t + teg.sin(x) ** 2, teg.bracket(x <= t) * a, teg.integral(teg.exp(-x), (x, 0, t)), v00 * height], ids=str
)
def test_matplotlib_can_read_it(e: teg.Expr) -> None:
    mathtext = pytest.importorskip("matplotlib.mathtext")
    mathtext.MathTextParser("path").parse(e._repr_latex_())


def test_an_expression_that_is_too_long_is_named_by_its_size() -> None:
    e: teg.Expr = x
    for _ in range(60):
        e = e * e + teg.sin(e)  # 2⁶⁰ terms if written out
    assert latex(e) == rf"\text{{an expression of {teg.size(e)} nodes}}"
    deep: teg.Expr = x
    for _ in range(100_000):
        deep = teg.sin(deep)
    assert latex(deep) == r"\text{an expression of 100001 nodes}"
