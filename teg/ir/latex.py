"""Printing in LaTeX: `latex(e)`, and the display of expressions and conditions in notebooks."""

from __future__ import annotations

import re
from typing import cast

from teg.ir.arrays import Gather, Placed, Ranged, Slope, StillGather, Sum, Unit
from teg.ir.choices import Nearest, Product
from teg.ir.expr import (
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
    Still,
    Truth,
    Tuple,
    Var,
    Where,
)
from teg.ir.function import Apply
from teg.ir.index import Index, IndexCall, IndexConst, IndexGather, IndexParam, IndexValue, IndexVar, Length, index_leaves
from teg.ir.integral import Delta, Integral, PointMasses
from teg.ir.node import Node, postorder
from teg.ir.operands import as_program

_SUM, _PRODUCT, _POWER, _ATOM = range(4)
_OR, _AND, _NOT = range(3)
_LIMIT = 100_000  # characters: shared subexpressions are written out each time, so text can be exponentially longer than the program

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
    """Returns the expression or condition in LaTeX, without dollar signs. One longer than `limit` characters is named by its size only.

        str(teg.latex(teg.sqrt(t) * x**2))                  # \\sqrt{t} \\, x^{2}

    A name of one letter, a Greek letter, or one of these with a number at its end (v00, an index) is printed as such, other names
    upright.
    """
    text: dict[Node, Text] = {}
    total = 0
    root = cast("Expr | Cond", as_program(root))
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
    """Returns the name of a variable or parameter."""
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
    """Returns a number as short as it can be written exactly; powers of ten as such."""
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
            return (rf"\overline{{{name(node.name)}}}" if isinstance(node, Still) else name(node.name)), _ATOM
        case Add():
            return _sum([p[0] for p in parts]), _SUM
        case Pow() if node.exponent < 0:
            return rf"\frac{{1}}{{{_reciprocal(node, parts[0])[0]}}}", _PRODUCT
        case Pow():
            return _power(parts[0], str(node.exponent)), _POWER
        case Apply():
            return _apply(node, [p[0] for p in parts])
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
        case Sum():
            return rf"\sum_{{{_range(node)}}} " + (parts[0][0] if isinstance(node.body, Sum) else _wrapped(parts[0], _PRODUCT)), _SUM
        case Product():
            return rf"\prod_{{{_range(node)}}} " + _wrapped(parts[0], _PRODUCT), _SUM
        case Nearest():
            value, key, condition, otherwise = (p[0] for p in parts)
            inside = rf"{value} ;\; {key} \mid {condition} ;\; {otherwise}"
            return rf"\operatorname{{nearest}}_{{{_range(node)}}}" + _in_brackets(inside), _ATOM
        case Ranged():
            title = type(node).__name__.lower().removesuffix("of")
            return rf"\operatorname{{{title}}}_{{{_range(node)}}}" + _in_brackets(", ".join(p[0] for p in parts)), _ATOM
        case Placed():
            title = r"\partial" if isinstance(node, Slope) else rf"\operatorname{{{type(node).__name__.lower()}}}"
            return title + rf"_{{{index(node.row)[0]}, {node.column}}} " + _wrapped(parts[0], _PRODUCT), _PRODUCT
        case Gather():
            entry = _subscripted(name(node.array.name), [index(i)[0] for i in node.subscripts])
            return rf"\overline{{{entry}}}" if isinstance(node, StillGather) else entry, _ATOM
        case Unit():
            places = ", ".join(index(i)[0] for i in node.subscripts)
            return rf"\mathbf{{1}}^{{{name(node.array.name)}}}_{{{places}}}", _ATOM
        case IndexValue():
            return index(node.index)
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
    """Returns the denominator of base^(-k)."""
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
        case "chosen" | "exact":
            return parts[0]
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


def _apply(node: Apply, parts: list[str]) -> Text:
    """Returns a user's function: its arguments, then the other parameters of its body."""
    slopes = (rf"\partial_{{{i}}}" + (f"^{{{k}}}" if k > 1 else "") + " " for i, k in enumerate(node.derivative, 1) if k)
    formal = node.callee.formal
    arguments = ", ".join(parts[:formal]) + (r";\, " + ", ".join(parts[formal:]) if len(parts) > formal else "")
    return "".join(slopes) + name(node.callee.title) + _in_brackets(arguments), _POWER


def _range(node: Ranged) -> str:
    """Returns a half-open range as a closed one: its last index is one less than its end."""
    hi = node.hi
    if isinstance(hi, IndexConst):
        last = str(hi.data - 1)
    elif isinstance(hi, IndexCall) and hi.data == "add" and isinstance(hi.children[1], IndexConst) and hi.children[1].data == 1:
        last = index(hi.children[0])[0]
    else:
        last = f"{index(hi)[0]} - 1"
    return rf"{name(node.index.name)} = {index(node.lo)[0]}}}^{{{last}"


def _subscripted(base: str, subscripts: list[str]) -> str:
    if "_" in base or "'" in base:
        base = "{" + base + "}"
    return f"{base}_{{{', '.join(subscripts)}}}"


def index(root: Index) -> Text:
    """Returns an integer expression."""
    text: dict[Node, Text] = {}
    for node in index_leaves([root]):
        parts = [text[c] for c in node.children]
        match node:
            case IndexConst():
                text[node] = str(node.data), _ATOM if node.data >= 0 else _SUM
            case IndexVar():
                text[node] = name(node.name), _ATOM
            case IndexParam():
                text[node] = name(node.param.name), _ATOM
            case Length():
                text[node] = rf"\operatorname{{length}}_{{{node.axis}}} {name(node.array.name)}", _POWER
            case IndexGather():
                text[node] = _subscripted(name(node.array.name), [p[0] for p in parts]), _ATOM
            case IndexCall():
                text[node] = _integers(node.data, *parts)
            case _:
                raise AssertionError(f"unknown index {type(node).__name__}")
    return text[root]


def _integers(operation: str, a: Text, b: Text) -> Text:
    match operation:
        case "add":
            return f"{a[0]} + {_wrapped(b, _PRODUCT)}", _SUM
        case "sub" if a[0] == "0":
            return f"-{_wrapped(b, _PRODUCT)}", _SUM
        case "sub":
            return f"{a[0]} - {_wrapped(b, _PRODUCT)}", _SUM
        case "mul":
            return _juxtaposed([_wrapped(a, _PRODUCT), _wrapped(b, _PRODUCT)]), _PRODUCT
        case "floordiv":
            return rf"\left\lfloor \frac{{{a[0]}}}{{{b[0]}}} \right\rfloor", _ATOM
        case "mod":
            return rf"\left({_wrapped(a, _POWER)} \bmod {_wrapped(b, _POWER)}\right)", _ATOM
        case _:
            return rf"\{operation}\left({a[0]}, {b[0]}\right)", _POWER


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
    """Returns a < b for the atom b - a > 0. Terms with a minus sign go to the left."""
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
    """Installs the notebook form of nodes."""
    for cls in (Expr, Cond):
        cls._repr_latex_ = lambda self: f"${latex(self)}$"  # type: ignore[union-attr]
    Index._repr_latex_ = lambda self: f"${index(self)[0]}$"  # type: ignore[attr-defined]


_install()
