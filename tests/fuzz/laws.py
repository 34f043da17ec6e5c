"""Laws: other programs of the same value and derivatives. The reference integrates the program as it was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from random import Random

from tests.fuzz.syntax import COMPARISONS, Term, again, monotone, rebuilt, substituted, term, variable, walk

Law = Callable[[Term, Random], Term]
EVERYWHERE = ("cube and itself", "double", "atan")
"""Increasing functions that are defined everywhere."""


def is_closed(node: Term) -> bool:
    return not any(n.op == "variable" for n in walk(node))


def over_boxes(tree: Term, change: Callable[[Term], Term]) -> Term:
    """With every integral changed whose bounds hold no variables, innermost first."""
    parts = tuple(over_boxes(p, change) for p in tree.parts)
    tree = tree if parts == tree.parts else replace(tree, parts=parts)
    if tree.op == "integral" and is_closed(tree.parts[1]) and is_closed(tree.parts[2]):
        return change(tree)
    return tree


def moved(tree: Term, distance: float) -> Term:
    """With all bounds farther to the right."""

    def change(node: Term) -> Term:
        body, *bounds = node.parts
        far = [term(b.data + distance) if b.op == "number" else b for b in bounds]
        return replace(node, parts=(body, *far))

    return over_boxes(tree, change)


def shift(tree: Term, random: Random) -> Term:
    c = random.choice((1.0, -3.0, 0.375, 64.0))

    def change(node: Term) -> Term:
        body, lo, hi = node.parts
        return replace(node, parts=(substituted(body, {node.data: variable(node.data) - c}), lo + c, hi + c))

    return over_boxes(tree, change)


def scale(tree: Term, random: Random) -> Term:
    k = random.choice((2.0, 1e3, 1e-3, 1e6))

    def change(node: Term) -> Term:
        body, lo, hi = node.parts
        return replace(node, parts=(substituted(body, {node.data: variable(node.data) / k}) / k, lo * k, hi * k))

    return over_boxes(tree, change)


def turn_around(tree: Term, random: Random) -> Term:
    """x becomes -x."""

    def change(node: Term) -> Term:
        body, lo, hi = node.parts
        return replace(node, parts=(substituted(body, {node.data: -variable(node.data)}), -hi, -lo))

    return over_boxes(tree, change)


def split(tree: Term, random: Random) -> Term:
    c = random.choice((0.37, 0.5, 0.8123))

    def change(node: Term) -> Term:
        body, lo, hi = node.parts
        middle = lo * (1 - c) + hi * c
        return replace(node, parts=(body, lo, middle)) + replace(node, parts=(body, middle, hi))

    done = [False]

    def once(node: Term) -> Term:
        if done[0]:
            return node
        done[0] = True
        return change(node)

    return over_boxes(tree, once)


def swap(tree: Term, random: Random) -> Term:
    """The order of integration of rectangles."""

    def change(node: Term) -> Term:
        inner = node.parts[0]
        if inner.op == "integral" and is_closed(inner.parts[1]) and is_closed(inner.parts[2]):
            outer = replace(node, parts=(inner.parts[0], *node.parts[1:]))
            return replace(inner, parts=(outer, *inner.parts[1:]))
        return node

    return over_boxes(tree, change)


def both_sides(tree: Term, random: Random) -> Term:
    """An increasing function of both sides of a condition."""
    name = random.choice(EVERYWHERE)
    return rebuilt_upwards(
        tree,
        lambda n: (
            replace(n, parts=(monotone(name, n.parts[0]), monotone(name, n.parts[1])))
            if n.op in COMPARISONS and random.random() < 0.7
            else n
        ),
    )


def nothing(tree: Term, random: Random) -> Term:
    """Zeros and ones that are written differently."""
    form = random.choice(("plus nothing", "twice a half", "neg of neg"))
    return rebuilt_upwards(tree, lambda n: again(form, n) if n.op == "parameter" and random.random() < 0.5 else n)


def complement(tree: Term, random: Random) -> Term:
    """c as not (not c), and c & d by de Morgan."""

    def change(n: Term) -> Term:
        if n.op == "and":
            return ~(~n.parts[0] | ~n.parts[1])
        if n.op == "bracket":
            return term(1) - Term("bracket", (~n.parts[0],))
        return n

    return rebuilt_upwards(tree, change)


def rebuilt_upwards(tree: Term, change: Callable[[Term], Term]) -> Term:
    parts = tuple(rebuilt_upwards(p, change) for p in tree.parts)
    return change(tree if parts == tree.parts else replace(tree, parts=parts))


LAWS: dict[str, Law] = {
    "shift": shift,
    "scale": scale,
    "turn around": turn_around,
    "split": split,
    "swap": swap,
    "both sides": both_sides,
    "nothing": nothing,
    "complement": complement,
}


def by_law(tree: Term, name: str, seed: int) -> Term:
    """The tree as the law named writes it ("": as it is). Disguises stay inside."""
    if not name:
        return tree
    return LAWS[name](tree, Random(seed))


__all__ = ["LAWS", "by_law", "rebuilt"]
