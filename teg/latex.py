"""Printing in LaTeX: `latex(e)`, and what notebooks show of an expression or a condition."""

from __future__ import annotations

import re

from teg.expr import (
    Add,
    And,
    Call,
    Compare,
    Cond,
    Const,
    Expr,
    Mul,
    Not,
    Or,
    Param,
    Pow,
    Truth,
    Tuple,
    Var,
    Where,
)
from teg.integral import Delta, Integral, PointMasses
from teg.node import Node, postorder

_SUM, _PRODUCT, _POWER, _ATOM = range(4)
_OR, _AND, _NOT = range(3)
_LIMIT = 100_000  # characters: what is shared is written out each time, so text can be exponentially longer than the program

_GREEK = re.compile(
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|iota|kappa|lambda|mu|nu|xi|pi|rho|sigma|tau|upsilon|phi|chi|psi|omega|"
    "Gamma|Delta|Theta|Lambda|Xi|Pi|Sigma|Upsilon|Phi|Psi|Omega"
)
_ESCAPES = {
    "\\": r"\backslash ", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "%": r"\%", "_": r"\_",
    "^": r"\hat{}", "~": r"\sim ", " ": r"\ ", "′": "'",
}  # fmt: skip
_FUNCTIONS = {
    **{f: "\\" + f for f in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "min", "max")},
    "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan",
}  # fmt: skip

Text = tuple[str, int]
"""LaTeX, and how tightly its outermost operation binds."""


def latex(root: Expr | Cond, limit: int = _LIMIT) -> str:
    """The expression or condition in LaTeX, without dollar signs; one longer than `limit` characters is named by its size only.

    A name of one letter, a Greek letter, or one of these with a number at its end (v00, an index) is printed as such, other names upright.
    """
    text: dict[Node, Text] = {}
    total = 0
    order = postorder([root])
    for node in order:
        if isinstance(node, Compare):
            text[node] = _comparison(node, text), _NOT
        elif isinstance(node, Mul):
            text[node] = _product(node, text)
        else:
            text[node] = _line(node, [text[c] for c in node.children])
        total += len(text[node][0])
        if total > 20 * limit or len(text[node][0]) > limit:
            return rf"\text{{an expression of {len(order)} nodes}}"
    return text[root][0]


def name(text: str) -> str:
    """A variable's or parameter's name."""
    base, digits = re.fullmatch(r"(.*?)(\d*)", text, re.DOTALL).groups()  # type: ignore[union-attr]
    stem = base.rstrip("′")
    primes = "'" * (len(base) - len(stem))
    if _GREEK.fullmatch(stem):
        letter = "\\" + stem
    elif len(stem) == 1 and stem not in _ESCAPES:
        letter = stem
    else:
        return r"\mathrm{" + "".join(_ESCAPES.get(c, c) for c in text) + "}"
    return letter + primes + (f"_{{{digits}}}" if digits else "")


def number(value: float) -> Text:
    """A number as short as it can be written exactly; powers of ten as such."""
    if value != value:
        return r"\mathrm{NaN}", _ATOM
    binding = _ATOM if value >= 0 else _SUM
    if abs(value) == float("inf"):
        return (r"\infty" if value > 0 else r"-\infty"), binding
    if value.is_integer() and abs(value) < 1e15:
        return str(int(value)), binding
    mantissa, _, exponent = repr(value).partition("e")
    if not exponent:
        return mantissa, binding
    power = f"10^{{{int(exponent)}}}"
    if mantissa in ("1", "-1"):
        return mantissa[:-1] + power, _POWER if value > 0 else _SUM
    return rf"{mantissa} \cdot {power}", _PRODUCT if value > 0 else _SUM


def _in_brackets(text: str) -> str:
    return rf"\left({text}\right)"


def _wrapped(part: Text, at_least: int) -> str:
    return part[0] if part[1] >= at_least else _in_brackets(part[0])


def _line(node: Node, parts: list[Text]) -> Text:
    match node:
        case Const():
            return number(node.data)
        case Param() | Var():
            return name(node.name), _ATOM
        case Add():
            return _sum([p[0] for p in parts]), _SUM
        case Pow() if node.exponent < 0:
            return rf"\frac{{1}}{{{_reciprocal(node, parts[0])[0]}}}", _PRODUCT
        case Pow():
            return _power(parts[0], str(node.exponent)), _POWER
        case Call():
            return _call(node, parts)
        case Where():
            return _where(parts)
        case Tuple():
            return _in_brackets(", ".join(p[0] for p in parts) + ("," if len(parts) == 1 else "")), _ATOM
        case Integral():
            body, lo, hi = parts
            sign = rf"\int_{{{lo[0]}}}^{{{hi[0]}}} "
            return sign + _wrapped(body, _PRODUCT) + rf" \,\mathrm{{d}}{name(node.var.name)}", _PRODUCT
        case Delta():
            return rf"\delta\!\left({parts[0][0]}\right)", _ATOM
        case PointMasses():
            return rf"\mu_{{{parts[0][0]} = 0}}", _ATOM
        case Truth():
            return rf"\mathrm{{{str(node.data).lower()}}}", _NOT
        case Not():
            return r"\neg " + _in_brackets(parts[0][0]), _NOT
        case And():
            return r" \wedge ".join(_wrapped(p, _AND) for p in parts), _AND
        case Or():
            return r" \vee ".join(p[0] for p in parts), _OR
        case _:
            raise AssertionError(f"unknown node {type(node).__name__}")


def _sum(terms: list[str]) -> str:
    text = terms[0]
    for term in terms[1:]:
        text += " - " + term[1:] if term.startswith("-") else " + " + term
    return text


def _power(base: Text, exponent: str) -> str:
    return f"{_wrapped(base, _ATOM)}^{{{exponent}}}"


def _reciprocal(node: Pow, base: Text) -> Text:
    """The denominator of base^(-k)."""
    return base if node.exponent == -1 else (_power(base, str(-node.exponent)), _POWER)


def _product(node: Mul, text: dict[Node, Text]) -> Text:
    above: list[str] = []
    below: list[Text] = []
    sign = ""
    for child in node.children:
        part = text[child]
        if isinstance(child, Const) and child.data < 0:
            sign = "-"
            if child.data != -1:
                above.append(part[0][1:])
        elif isinstance(child, Pow) and child.exponent < 0:
            below.append(_reciprocal(child, text[child.base]))
        else:
            above.append(_wrapped(part, _PRODUCT))
    product = _juxtaposed(above) if above else "1"
    if below:
        denominator = below[0][0] if len(below) == 1 else _juxtaposed([_wrapped(b, _PRODUCT) for b in below])
        product = rf"\frac{{{product}}}{{{denominator}}}"
    return sign + product, _SUM if sign else _PRODUCT


def _juxtaposed(factors: list[str]) -> str:
    text = factors[0]
    for factor in factors[1:]:
        text += (r" \cdot " if factor[0].isdigit() else r" \, ") + factor
    return text


def _call(node: Call, parts: list[Text]) -> Text:
    arguments = ", ".join(p[0] for p in parts)
    match node.name:
        case "sqrt" | "root":
            return rf"\sqrt{{{arguments}}}", _ATOM
        case "pow":
            return _power(parts[0], parts[1][0]), _POWER
        case "magnitude":
            return rf"\left|{arguments}\right|", _ATOM
        case "floor":
            return rf"\left\lfloor {arguments} \right\rfloor", _ATOM
        case "ceil":
            return rf"\left\lceil {arguments} \right\rceil", _ATOM
        case other:
            function = _FUNCTIONS.get(other, rf"\operatorname{{{other}}}")
            return function + _in_brackets(arguments), _POWER


def _where(parts: list[Text]) -> Text:
    condition, then, otherwise = parts
    bracket = rf"\left[\,{condition[0]}\,\right]"
    if otherwise[0] == "0":
        if then[0] == "1":
            return bracket, _ATOM
        return rf"{bracket} \, {_wrapped(then, _PRODUCT)}", _PRODUCT
    rows = rf"{then[0]} & \text{{if }} {condition[0]} \\ {otherwise[0]} & \text{{otherwise}}"
    return rf"\begin{{cases}} {rows} \end{{cases}}", _PRODUCT


def _comparison(node: Compare, text: dict[Node, Text]) -> str:
    """a < b for the atom b - a > 0: the terms with a minus sign go to the left."""
    relation = "<" if node.strict else r"\leq"
    if not isinstance(node.g, Add):
        g = text[node.g][0]
        if g.startswith("-"):
            return f"{g[1:]} {relation} 0"
        return f"0 {relation} {g}"
    left: list[str] = []
    right: list[str] = []
    for child in node.g.children:
        term = text[child][0]
        if isinstance(child, Mul | Const) and term.startswith("-"):
            left.append(term[1:])
        else:
            right.append(term)
    return f"{_sum(left) if left else '0'} {relation} {_sum(right) if right else '0'}"


def _install() -> None:
    """Give nodes their notebook form, from this higher floor."""
    for cls in (Expr, Cond):
        cls._repr_latex_ = lambda self: f"${latex(self)}$"  # type: ignore[union-attr]


_install()
