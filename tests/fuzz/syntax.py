"""The syntax tree of random programs. It shares nothing with the compiler: `build` writes it as an expression of `teg`, `source` as
Python text, `reference.py` evaluates it.

    number(c) variable(x) parameter(t) entry(V, k)      leaves; the data is the number or the name
    + - * / neg pow abs min max where bracket call      numbers; `call` has the function's name as its data
    < <= > >= and or not                                conditions
    disguised(f)(u, v)                                  the condition f(u) < f(v), f increasing; in the reference u < v
    again(u)                                            u, in words that the data names; in the reference u
    integral(x)(body, lo, hi)   sum(k, n)(body)         binders
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import teg

Number = float | int


@dataclass(frozen=True, slots=True)
class Term:
    """One node: an operation, its operands, and what is no operand."""

    op: str
    parts: tuple[Term, ...] = ()
    data: Any = None

    def __add__(self, other: Operand) -> Term:
        return Term("+", (self, term(other)))

    def __radd__(self, other: Operand) -> Term:
        return Term("+", (term(other), self))

    def __sub__(self, other: Operand) -> Term:
        return Term("-", (self, term(other)))

    def __rsub__(self, other: Operand) -> Term:
        return Term("-", (term(other), self))

    def __mul__(self, other: Operand) -> Term:
        return Term("*", (self, term(other)))

    def __rmul__(self, other: Operand) -> Term:
        return Term("*", (term(other), self))

    def __truediv__(self, other: Operand) -> Term:
        return Term("/", (self, term(other)))

    def __rtruediv__(self, other: Operand) -> Term:
        return Term("/", (term(other), self))

    def __neg__(self) -> Term:
        return Term("neg", (self,))

    def __pow__(self, other: Operand) -> Term:
        return Term("pow", (self, term(other)))

    def __lt__(self, other: Operand) -> Term:
        return Term("<", (self, term(other)))

    def __le__(self, other: Operand) -> Term:
        return Term("<=", (self, term(other)))

    def __gt__(self, other: Operand) -> Term:
        return Term(">", (self, term(other)))

    def __ge__(self, other: Operand) -> Term:
        return Term(">=", (self, term(other)))

    def __and__(self, other: Term) -> Term:
        return Term("and", (self, other))

    def __or__(self, other: Term) -> Term:
        return Term("or", (self, other))

    def __invert__(self) -> Term:
        return Term("not", (self,))


Operand = Term | Number


def term(value: Operand) -> Term:
    return value if isinstance(value, Term) else Term("number", (), float(value))


def variable(name: str) -> Term:
    return Term("variable", (), name)


def parameter(name: str) -> Term:
    return Term("parameter", (), name)


def entry(array: str, index: str | int) -> Term:
    return Term("entry", (), (array, index))


def call(name: str, *operands: Operand) -> Term:
    return Term("call", tuple(map(term, operands)), name)


def absolute(u: Operand) -> Term:
    return Term("abs", (term(u),))


def bracket(condition: Term) -> Term:
    return Term("bracket", (condition,))


def where(condition: Term, then: Operand, otherwise: Operand) -> Term:
    return Term("where", (condition, term(then), term(otherwise)))


def integral(body: Operand, *domain: tuple[str, Operand, Operand]) -> Term:
    result = term(body)
    for name, lo, hi in domain:
        result = Term("integral", (result, term(lo), term(hi)), name)
    return result


def total(body: Operand, index: str, count: int) -> Term:
    return Term("sum", (term(body),), (index, count))


def minimum(u: Operand, v: Operand) -> Term:
    return Term("min", (term(u), term(v)))


def maximum(u: Operand, v: Operand) -> Term:
    return Term("max", (term(u), term(v)))


COMPARISONS = ("<", "<=", ">", ">=")
CONDITIONS = frozenset((*COMPARISONS, "and", "or", "not", "disguised"))


@dataclass(frozen=True)
class Program:
    """A closed tree with the values of its parameters. `scales` says how large a change of a parameter is an ordinary one;
    `law` names one of `laws.py`, by which the compiler's program is written differently. `far` is added to all bounds and
    parameters when the compiler gets the program, which is one of differences of coordinates."""

    kind: str
    tree: Term
    values: dict[str, float | tuple[float, ...]]
    scales: dict[str, float] = field(default_factory=dict)
    seed: int = 0
    law: str = ""
    far: float = 0.0

    def scale(self, name: str) -> float:
        """Of a parameter, or of the entries of an array."""
        if name in self.scales:
            return self.scales[name]
        value = self.values[name]
        sizes = [abs(v) for v in (value if isinstance(value, tuple) else (value,))]
        return max(sizes) or 1.0

    def with_tree(self, tree: Term) -> Program:
        """The same with another tree, and those values only that it has."""
        names = leaves(tree)
        return replace(self, tree=tree, values={k: v for k, v in self.values.items() if k in names})


def walk(tree: Term) -> Iterator[Term]:
    """Every node, parents first."""
    stack = [tree]
    while stack:
        node = stack.pop()
        yield node
        stack.extend(node.parts)


def leaves(tree: Term) -> set[str]:
    """The names of parameters and arrays."""
    return {n.data if n.op == "parameter" else n.data[0] for n in walk(tree) if n.op in ("parameter", "entry")}


def size(tree: Term) -> int:
    return sum(1 for _ in walk(tree))


def rebuilt(tree: Term, change: Callable[[Term], Term | None]) -> Term:
    """The tree with every node replaced for which `change` gives another."""
    new = change(tree)
    if new is not None:
        return new
    parts = tuple(rebuilt(p, change) for p in tree.parts)
    return tree if parts == tree.parts else replace(tree, parts=parts)


def substituted(tree: Term, new: Mapping[str, Term]) -> Term:
    """With other terms in place of variables and parameters, by name; binders are not looked at, so names must be apart."""
    return rebuilt(tree, lambda n: new.get(n.data) if n.op in ("variable", "parameter") else None)


def grounded(tree: Term) -> Term:
    """Without sums: they are written out, and an entry becomes the parameter `V[0]`."""
    if tree.op == "sum":
        index, count = tree.data
        body = tree.parts[0]
        terms = [grounded(rebuilt(body, lambda n, k=k: _entry_at(n, index, k))) for k in range(count)]
        result = terms[0]
        for t in terms[1:]:
            result = result + t
        return result
    if tree.op == "entry":
        return parameter(f"{tree.data[0]}[{tree.data[1]}]")
    parts = tuple(grounded(p) for p in tree.parts)
    return tree if parts == tree.parts else replace(tree, parts=parts)


def _entry_at(node: Term, index: str, k: int) -> Term | None:
    return entry(node.data[0], k) if node.op == "entry" and node.data[1] == index else None


# -- disguises: what is the same in other words -------------------------------------------------------------------------

MONOTONE: dict[str, tuple[str, float, float]] = {
    "exp": ("exp({u})", -30.0, 30.0),
    "atan": ("atan({u})", -50.0, 50.0),
    "tanh": ("tanh({u})", -3.0, 3.0),
    "cube": ("({u})**3", -1e3, 1e3),
    "cube and itself": ("({u}) + ({u})**3", -1e3, 1e3),
    "sinh": ("sinh({u})", -5.0, 5.0),
    "log": ("log({u})", 1e-9, math.inf),
    "sqrt": ("sqrt({u})", 1e-9, math.inf),
    "square": ("({u})*({u})", 1e-9, math.inf),
    "minus reciprocal": ("-1/({u})", 1e-9, math.inf),
    "times exp": ("({u})*exp({u})", 1e-9, 20.0),
    "double": ("2*({u})", -math.inf, math.inf),
}
"""Increasing functions, and where they may be used: between these arguments."""


def monotone(name: str, u: Term) -> Term:
    """The increasing function of u."""
    match name:
        case "cube":
            return u**3
        case "cube and itself":
            return u + u**3
        case "square":
            return u * u
        case "minus reciprocal":
            return -1 / u
        case "times exp":
            return u * call("exp", u)
        case "double":
            return 2 * u
    return call(name, u)


def again(name: str, u: Term) -> Term:
    """u once more, in other words."""
    match name:
        case "plus nothing":
            return u + (u - u)
        case "twice a half":
            return 0.5 * u + 0.5 * u
        case "log of exp":
            return call("log", call("exp", u))
        case "sine and cosine":
            return u * (call("sin", u) ** 2 + call("cos", u) ** 2)
        case "difference of squares":
            return (u * u - 1) / (u - 1) - 1 if u.op == "number" else ((u + 2) * (u + 2) - u * u - 4) / 4
        case "neg of neg":
            return Term("neg", (Term("neg", (u,)),))
    raise ValueError(name)


AGAIN = ("plus nothing", "twice a half", "log of exp", "sine and cosine", "difference of squares", "neg of neg")


def plain(tree: Term) -> Term:
    """What the reference evaluates: without disguises."""
    parts = tuple(plain(p) for p in tree.parts)
    if tree.op == "disguised":
        return Term("<", parts)
    if tree.op == "again":
        return parts[0]
    return tree if parts == tree.parts else replace(tree, parts=parts)


def worded(tree: Term) -> Term:
    """What the compiler is given: disguises written out."""
    parts = tuple(worded(p) for p in tree.parts)
    if tree.op == "disguised":
        return Term("<", (monotone(tree.data, parts[0]), monotone(tree.data, parts[1])))
    if tree.op == "again":
        return again(tree.data, parts[0])
    return tree if parts == tree.parts else replace(tree, parts=parts)


# -- as an expression, and as text ----------------------------------------------------------------------------------------

OPERATORS: dict[str, Callable[..., Any]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "neg": lambda a: -a,
    "pow": lambda a, b: a**b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "and": lambda a, b: a & b,
    "or": lambda a, b: a | b,
    "not": lambda a: ~a,
    "abs": lambda a: teg.abs(a),
    "min": lambda a, b: teg.minimum(a, b),
    "max": lambda a, b: teg.maximum(a, b),
    "where": lambda c, a, b: teg.where(c, a, b),
    "bracket": lambda c: teg.bracket(c),
}


def build(tree: Term) -> Any:
    """The expression of `teg`."""
    return _built(worded(tree), {})


def _built(node: Term, memory: dict[Term, Any]) -> Any:
    if node in memory:
        return memory[node]
    match node.op:
        case "number":
            found: Any = _plain_number(node.data)
        case "variable":
            found = teg.var(node.data)
        case "parameter":
            found = teg.param(node.data)
        case "entry":
            array, index = node.data
            found = teg.array(array)[teg.index(index) if isinstance(index, str) else index]
        case "call":
            found = getattr(teg, node.data)(*(_built(p, memory) for p in node.parts))
        case "integral":
            body, lo, hi = (_built(p, memory) for p in node.parts)
            found = teg.integral(body, (teg.var(node.data), lo, hi))
        case "sum":
            index, count = node.data
            found = teg.sum(_built(node.parts[0], memory), (teg.index(index), 0, count))
        case _:
            found = OPERATORS[node.op](*(_built(p, memory) for p in node.parts))
    memory[node] = found
    return found


def _plain_number(value: float) -> float | int:
    return int(value) if value == int(value) and abs(value) < 2**53 else value


def source(tree: Term) -> str:
    """Python text of the expression."""
    return _text(worded(tree))


def _text(node: Term) -> str:
    parts = [_text(p) for p in node.parts]
    match node.op:
        case "number":
            value = _plain_number(node.data)
            return f"({value!r})" if value < 0 else repr(value)
        case "variable" | "parameter":
            return str(node.data)
        case "entry":
            return f"{node.data[0]}[{node.data[1]}]"
        case "neg":
            return f"(-{parts[0]})"
        case "not":
            return f"(~{parts[0]})"
        case "pow":
            return f"{parts[0]}**{parts[1]}"
        case "and" | "or":
            return f"({parts[0]} {'&' if node.op == 'and' else '|'} {parts[1]})"
        case "integral":
            return f"teg.integral({parts[0]}, ({node.data}, {parts[1]}, {parts[2]}))"
        case "sum":
            return f"teg.sum({parts[0]}, ({node.data[0]}, 0, {node.data[1]}))"
        case "call":
            return f"teg.{node.data}({', '.join(parts)})"
        case "abs" | "where" | "bracket":
            return f"teg.{node.op}({', '.join(parts)})"
        case "min" | "max":
            return f"teg.{node.op}imum({', '.join(parts)})"
    return f"({parts[0]} {node.op} {parts[1]})"


def as_python(program: Program, backend: str = "numpy", lines: tuple[str, ...] = ()) -> str:
    """A program that can be run as it is, with comments in front."""
    nodes = list(walk(program.tree))
    variables = sorted({n.data for n in nodes if n.op == "integral"})
    scalars = sorted({n.data for n in nodes if n.op == "parameter"})
    arrays = sorted({n.data[0] for n in nodes if n.op == "entry"})
    indices = sorted({n.data[0] for n in nodes if n.op == "sum"})
    text = [f"# {line}" for line in lines]
    text.append("import teg\n")
    text += [f"{v} = teg.var({v!r})" for v in variables]
    text += [f"{p} = teg.param({p!r})" for p in scalars]
    text += [f"{a} = teg.array({a!r})" for a in arrays]
    text += [f"{k} = teg.index({k!r})" for k in indices]
    text.append(f"e = {source(program.tree)}")
    wrt = ", ".join([*scalars, *arrays])
    text.append(f"f = teg.compile(e, [{wrt}], backend={backend!r})")
    values = {k: list(v) if isinstance(v, tuple) else v for k, v in program.values.items()}
    text.append(f"print(f.value_and_grad({values!r}))")
    return "\n".join(text)
