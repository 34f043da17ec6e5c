"""Printing: readable Unicode mathematics (`show`) and a listing that shows sharing (`dump`)."""

from __future__ import annotations

from collections.abc import Mapping

from teg.ir.arrays import LEAVES, Ranged, Sum, show_leaf
from teg.ir.choices import AnyOf, Nearest, Product
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
from teg.ir.integral import Delta, Integral, PointMasses
from teg.ir.node import Node, postorder

_SUM, _PRODUCT, _POWER, _ATOM = range(4)
_OR, _AND, _NOT = range(3)
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LIMIT = 100_000  # characters: shared subexpressions are written out, so text can be exponentially longer than the program


def number(value: float) -> str:
    """Returns a number as short as it can be written exactly."""
    if float(value).is_integer() and abs(value) < 1e15:
        return str(int(value))
    return {"inf": "∞", "-inf": "-∞"}.get(repr(value), repr(value))


def show(root: Node, limit: int = _LIMIT) -> str:
    """Returns the expression as one line of mathematics; a program too long for that as a listing."""
    text = show_within(root, limit)
    return dump(root) if text is None else text


def show_within(root: Node, limit: int) -> str | None:
    """Returns the expression as one line of mathematics; None if it is too long for that."""
    text: dict[Node, tuple[str, int]] = {}
    total = 0
    for node in postorder([root]):
        text[node] = _line(node, [text[c] for c in node.children], text)
        total += len(text[node][0])
        if total > 20 * limit or len(text[node][0]) > limit:
            return None
    return text[root][0]


def shortened(root: Node, length: int) -> str:
    """Returns the first characters of the expression as one line; what its operation is, if that line is much longer."""
    text = show_within(root, 20 * length)
    return (_operation(root) if text is None else text)[:length]


def _wrapped(part: tuple[str, int], at_least: int) -> str:
    return part[0] if part[1] >= at_least else f"({part[0]})"


def _line(node: Node, parts: list[tuple[str, int]], text: Mapping[Node, tuple[str, int]]) -> tuple[str, int]:
    match node:
        case Const():
            return number(node.data), _ATOM if node.data >= 0 else _SUM
        case Param() | Var():
            return (f"stop({node.name})" if isinstance(node, Still) else node.name), _ATOM
        case Add():
            out = ""
            for i, p in enumerate(parts):
                term = p[0]
                if i and term.startswith("-"):
                    out += " - " + term[1:]
                else:
                    out += (" + " if i else "") + term
            return out, _SUM
        case Mul():
            return _product(node, parts)
        case Pow():
            if node.exponent == -1:
                return "1/" + _wrapped(parts[0], _POWER), _PRODUCT
            return _wrapped(parts[0], _ATOM) + str(node.exponent).translate(_SUPERSCRIPT), _POWER
        case Apply():
            inputs = [p[0] for p in parts]
            others = "; " + ", ".join(inputs[node.callee.formal :]) if len(inputs) > node.callee.formal else ""
            return f"{node.title}({', '.join(inputs[: node.callee.formal])}{others})", _ATOM
        case Call():
            if node.name == "magnitude":
                return f"|{parts[0][0]}|", _ATOM
            if node.name in ("sqrt", "root"):
                return "√" + _wrapped(parts[0], _ATOM), _ATOM
            if node.name == "pow":
                return f"{_wrapped(parts[0], _ATOM)}^{_wrapped(parts[1], _ATOM)}", _POWER
            return parts[0] if node.name in ("chosen", "exact") else (f"{node.name}({', '.join(p[0] for p in parts)})", _ATOM)
        case Where():
            c, a, b = (p[0] for p in parts)
            if (a, b) == ("1", "0"):
                return f"[{c}]", _ATOM
            if b == "0":
                return f"[{c}]·{_wrapped(parts[1], _PRODUCT)}", _PRODUCT
            return f"where({c}, {a}, {b})", _ATOM
        case Tuple():
            return "(" + ", ".join(p[0] for p in parts) + ("," if len(parts) == 1 else "") + ")", _ATOM
        case Integral():
            body, lo, hi = parts
            return f"∫[{node.var.name}: {lo[0]}..{hi[0]}] {_wrapped(body, _PRODUCT)}", _SUM
        case Delta():
            return f"δ({parts[0][0]})", _ATOM
        case Sum():
            return f"Σ[{node.index.name}: {node.lo}..{node.hi}] {_wrapped(parts[0], _PRODUCT)}", _SUM
        case Ranged():
            return _ranged_line(node, parts)
        case _ if isinstance(node, LEAVES):
            return show_leaf(node), _ATOM
        case PointMasses():
            return f"masses({parts[0][0]} = 0)", _ATOM
        case Cond():
            return _condition_line(node, parts, text)
        case _:
            raise AssertionError(f"unknown node {type(node).__name__}")


def _ranged_line(node: Ranged, parts: list[tuple[str, int]]) -> tuple[str, int]:
    over = f"[{node.index.name}: {node.lo}..{node.hi}]"
    match node:
        case Product():
            return f"Π{over} {_wrapped(parts[0], _PRODUCT)}", _SUM
        case AnyOf():
            return f"any{over}({parts[0][0]})", _ATOM
        case Nearest():
            value, key, condition, otherwise = (p[0] for p in parts)
            return f"nearest{over}({value}; {key} | {condition}; {otherwise})", _ATOM
        case _:
            return f"{type(node).__name__.lower()}{over}({', '.join(p[0] for p in parts)})", _ATOM


def _condition_line(node: Cond, parts: list[tuple[str, int]], text: Mapping[Node, tuple[str, int]]) -> tuple[str, int]:
    match node:
        case Truth():
            return ("true" if node.data else "false"), _NOT
        case Compare():
            return _comparison(node, text), _NOT
        case Not():
            return "~" + (parts[0][0] if parts[0][1] > _NOT else f"({parts[0][0]})"), _NOT
        case And():
            return " & ".join(f"({p[0]})" if p[1] < _AND else p[0] for p in parts), _AND
        case Or():
            return " | ".join(p[0] for p in parts), _OR
        case _:
            raise AssertionError(f"unknown condition {type(node).__name__}")


def _product(node: Mul, parts: list[tuple[str, int]]) -> tuple[str, int]:
    above: list[str] = []
    below: list[str] = []
    sign = ""
    for child, part in zip(node.children, parts, strict=True):
        if isinstance(child, Const) and child.data == -1:
            sign = "-"
        elif isinstance(child, Const) and child.data < 0:
            sign = "-"
            above.append(number(-child.data))
        elif isinstance(child, Pow) and child.exponent < 0:
            base = part[0][2:] if child.exponent == -1 else part[0].replace("⁻", "", 1) if part[0].endswith(("⁻²", "⁻³")) else None
            if base is None:
                above.append(_wrapped(part, _POWER))
            else:
                below.append(base)
        else:
            above.append(_wrapped(part, _POWER))
    text = sign + ("·".join(above) or "1")
    if below:
        text += "/" + (below[0] if len(below) == 1 else "(" + "·".join(below) + ")")
    return text, _PRODUCT


def _comparison(node: Compare, text: Mapping[Node, tuple[str, int]]) -> str:
    whole = text[node.g][0]
    relation = (" < ", " > ") if node.strict else (" ≤ ", " ≥ ")
    if isinstance(node.g, Add) and len(node.g.children) == 2:
        a, b = node.g.children
        left, right = text[a][0], text[b][0]
        if right.startswith("-") and " + " not in right and " - " not in right[1:]:
            return right[1:] + relation[0] + left
        if left.startswith("-") and " + " not in left and " - " not in left[1:]:
            return left[1:] + relation[0] + right
        if isinstance(b, Const) and b.data < 0:
            return left + relation[1] + number(-b.data)
    if isinstance(node.g, Mul) and isinstance(node.g.children[0], Const) and node.g.children[0].data == -1:
        return whole[1:] + relation[0] + "0"
    return whole + relation[1] + "0"


def dump(*roots: Node) -> str:
    """Returns a listing of each distinct node once, a line each: %n = operation(%m, …). It shows what is shared.

    print(teg.dump(teg.sin(t) + teg.sin(t) ** 2))
    """
    order = postorder(roots)
    label: dict[Node, str] = {}
    lines: list[str] = []
    for node in order:
        if isinstance(node, Const | Param | Var | Truth):
            label[node] = number(node.data) if isinstance(node, Const) else str(node.data)
            continue
        if isinstance(node, LEAVES):
            label[node] = show_leaf(node)
            continue
        label[node] = f"%{len(lines)}"
        children = ", ".join(label[c] for c in node.children)
        lines.append(f"{label[node]} = {_operation(node)}({children})")
    lines.extend(f"result {label[r]}" for r in roots)
    return "\n".join(lines)


def _operation(node: Node) -> str:
    match node:
        case Apply():
            return node.title
        case Call():
            return node.name
        case Pow():
            return f"power[{node.exponent}]"
        case Integral():
            return f"integral[{node.var.name}]"
        case Sum():
            return f"sum[{node.index.name}: {node.lo}..{node.hi}]"
        case Ranged():
            return f"{type(node).__name__.lower()}[{node.index.name}: {node.lo}..{node.hi}]"
        case Compare():
            return "positive" if node.strict else "nonnegative"
        case _:
            return type(node).__name__.lower()


def _short(node: Node) -> str:
    return show(node, 2000)


def _install() -> None:
    """Installs the text of nodes; the module of nodes knows no printing."""
    for cls in (Expr, Cond):
        cls.__str__ = show  # type: ignore[assignment]
        cls.__repr__ = _short  # type: ignore[assignment]


_install()
