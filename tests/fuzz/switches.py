"""Where an integrand switches: the functions at whose roots it may be anything but smooth."""

from __future__ import annotations

import math

from tests.fuzz.syntax import COMPARISONS, Term, walk


def depth_of(tree: Term) -> int:
    """How many integrals stand inside each other."""
    return (tree.op == "integral") + max((depth_of(p) for p in tree.parts), default=0)


def has(tree: Term, var: str) -> bool:
    return any(n.op == "variable" and n.data == var for n in walk(tree))


def switches_in(body: Term, var: str) -> list[tuple[str, Term]]:
    """Functions at whose roots an integrand may be anything but smooth, or turn quickly ("roots"); and the integrals inside it that depend
    on the variable ("cuts")."""
    found: dict[tuple[str, Term], None] = {}

    def note(node: Term) -> None:
        for switch in _switches_of(node):
            if has(switch, var):
                found["roots", switch] = None

    def visit(node: Term) -> None:
        if node.op == "integral":
            if has(node, var):
                for bound in node.parts[1:]:
                    visit(bound)
                found["cuts", node] = None
                for n in walk(node.parts[0]):  # what does not depend on the inner variable
                    if n.op != "integral" and not has(n, node.data) and has(n, var) and not _bound_inside(node.parts[0], n):
                        note(n)
            return
        for p in node.parts:
            visit(p)
        if has(node, var):
            note(node)

    visit(body)
    return list(found)


def _bound_inside(body: Term, node: Term) -> bool:
    """Whether a node has variables of integrals inside a body."""
    return any(n.op == "integral" and has(node, n.data) for n in walk(body))


def _switches_of(node: Term) -> list[Term]:
    p = node.parts
    if node.op in (*COMPARISONS, "min", "max"):
        return [p[0] - p[1]]
    if node.op == "abs":
        return [p[0]]
    if node.op == "pow" and p[1].op == "number" and p[1].data in (0.0, 1.0, 2.0, 3.0):
        return [p[0]] if p[0].op != "variable" else []
    if node.op == "pow":
        return [p[0]]
    if node.op == "*" and p[0] == p[1] and p[0].op != "variable":
        return [p[0]]
    if node.op == "/":
        return [p[1]]
    if node.op == "call":
        pi = Term("number", (), math.pi)
        match node.data:
            case "floor" | "ceil":
                return [Term("call", (pi * p[0],), "sin")]
            case "round":
                return [Term("call", (pi * p[0],), "cos")]
            case "mod":
                return [Term("call", (pi * (p[0] / p[1]),), "sin")]
            case "asin" | "acos":
                return [p[0] - 1, p[0] + 1, p[0]]
            case "log":
                return [p[0], p[0] - 1]
            case "sin" | "cos":
                return []
        return list(p)
    return []
