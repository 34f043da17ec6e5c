"""To SymPy and back, and Jacobians that SymPy simplifies. The only importer of SymPy, which is imported when first needed.

    c                        Integer, or Float of 53 bits, oo, nan: no bit is lost
    p, x                     Symbol(name, real=True)
    √u, root(u)              u^(1/2), |u|^(1/2)
    [g > 0], [g >= 0]        Heaviside(g, 0), Heaviside(g, 1): the second argument is the value where g = 0
    where(c, a, 0)           a·Heaviside(…)·…, if a is finite everywhere and c is atoms joined by &
    where(c, a, b)           Abs, sign, Min, Max if it is one of these, else Piecewise((a, c), (b, True))
    ∫ₗʰ e dx, δ(g)           Integral(e, (x, l, h)), DiracDelta(g)

Both ways are iterative and linear: a node that is shared is converted once, and SymPy's constructors, which look at all of an expression
written out, are passed by. SymPy's own functions have no such care: printing, comparing or simplifying what is shared costs what it is
written out, and an expression some hundred nodes deep ends in Python's RecursionError.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, reduce
from typing import Any, cast

from teg import build
from teg import expr as ex
from teg.calculus import slope
from teg.errors import BoundError, MissingPackageError, NameClashError, OperandError, OptionError, ParameterError, TegError
from teg.expr import (
    MINUS_ONE,
    ONE,
    ZERO,
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
from teg.integral import Delta, Integral
from teg.node import Node, postorder
from teg.traverse import size, substitute

CONDITIONS = ("auto", "heaviside", "piecewise")

_WRITTEN_OUT = 2000  # nodes that SymPy's constructors are given,
_OPERATIONS = 150  # and operations that its simplifiers are given: about a second each
_FLATTEN = 8  # integrals inside each other, and factors, are written as one while they are so few: more would be quadratic


@cache
def _sympy() -> Any:
    try:
        import sympy
    except ImportError as error:
        raise MissingPackageError("SymPy is not installed", None, 'pip install "teg[symbolic]"') from error
    return sympy


def to_sympy(e: object, *, evaluate: bool = False, conditions: str = "auto", symbols: Mapping[Any, Any] | None = None) -> Any:
    """The SymPy form of an expression, a tuple or a condition, by the table above; its values are the same, on borders as well.

    evaluate:   False writes what is there. True goes through SymPy's constructors, which collect and sort terms, so that == with other
                SymPy expressions means something; they round anew, and are for short expressions.
    conditions: "auto" is the table; "heaviside" makes everything of Heavisides, so that `sympy.diff` knows all jumps, but a branch not
                taken must then be finite; "piecewise" knows no Heaviside, which `sympy.integrate` prefers.
    symbols:    other symbols for some parameters and variables.

    What the compiler writes only for itself, how ties are resolved, is left out. Raises NameClashError where a parameter and a variable
    have one name, OptionError for an expression too long for evaluate=True, OperandError for a node without a form in SymPy,
    MissingPackageError without SymPy.
    """
    root = e if isinstance(e, Cond | Tuple) else ex.as_number(e)
    if conditions not in CONDITIONS:
        raise OptionError(f"conditions={conditions!r} is none of {', '.join(CONDITIONS)}")
    if evaluate and _written_out(root) > _WRITTEN_OUT:
        raise OptionError(f"written out, the expression has more than {_WRITTEN_OUT} nodes", root, "leave evaluate=False")
    for node, symbol in (symbols or {}).items():
        if not isinstance(node, Param | Var) or not isinstance(symbol, _sympy().Symbol):
            raise ParameterError("symbols= gives SymPy symbols for parameters and variables", node)
    named = _symbols_of(root, symbols or {})
    try:
        return _Writer(named, evaluate, conditions).write(root)
    except Exception as error:  # of any kind: SymPy has no class for what its constructors cannot do
        if not evaluate or isinstance(error, TegError):
            raise
        raise OptionError(f"SymPy cannot evaluate this: {error}", root, "leave evaluate=False") from error


def _symbols_of(root: Node, given: Mapping[Any, Any]) -> dict[Node, Any]:
    """A symbol of its own for every parameter and variable: the one given, or the real one of the same name."""
    symbol = _sympy().Symbol
    found: dict[Node, Any] = {}
    stands_for: dict[Any, Node] = {}
    for node in postorder([root]):
        leaf = node.var if isinstance(node, Integral) else node
        if isinstance(leaf, Param | Var) and leaf not in found:
            found[leaf] = given[leaf] if leaf in given else symbol(leaf.name, real=True)
            if stands_for.setdefault(found[leaf], leaf) is not leaf:
                raise NameClashError(
                    f"{leaf.name!r} would stand for a parameter and a variable", root, "rename one of them, or give symbols="
                )
    return found


def _written_out(root: Node) -> int:
    """The number of nodes if what is shared were written out each time."""
    length: dict[Node, int] = {}
    for node in postorder([root]):
        length[node] = 1 + sum([length[c] for c in node.children])
    return length[root]


class _Writer:
    """The language's nodes to SymPy's, each once; several expressions may share them."""

    def __init__(self, symbols: Mapping[Node, Any], evaluate: bool, conditions: str, exact: bool = False) -> None:
        self.sympy = _sympy()
        self.symbols = symbols
        self.evaluate = evaluate
        self.conditions = conditions
        self.exact = exact  # numbers as fractions, so that SymPy's algebra is exact
        self.done: dict[Node, Any] = {}
        self.finite: set[Node] = set()  # everywhere: no pole, no root or logarithm of something negative
        self.steps: dict[Cond, Any] = {}

    def write(self, root: Node) -> Any:
        for node in postorder([root]):
            if node not in self.done:
                self.done[node] = self.form(node)
                if _is_finite(node, self.finite):
                    self.finite.add(node)
        return self.done[root]

    def make(self, kind: Any, *parts: Any) -> Any:
        """A SymPy node, by its constructor if it is to be evaluated."""
        return kind(*parts) if self.evaluate else self.as_it_is(kind, *parts)

    def as_it_is(self, kind: Any, *parts: Any) -> Any:
        """A SymPy node with these parts and no others. It is hashed, and SymPy remembers that: hashing what holds it is not deep then."""
        sympy = self.sympy
        node = sympy.Basic.__new__(kind, *parts)
        if issubclass(kind, sympy.Add | sympy.Mul | sympy.Pow | sympy.Integral):
            node.is_commutative = True
        elif issubclass(kind, sympy.And | sympy.Or | sympy.Min | sympy.Max):
            node._argset = frozenset(parts)
        elif isinstance(node, sympy.Expr):
            _ = node.is_commutative  # SymPy remembers this as well
        hash(node)
        return node

    def form(self, node: Node) -> Any:
        sympy, parts = self.sympy, [self.done[c] for c in node.children]
        match node:
            case Const():
                return self.number(node.data)
            case Param() | Var():
                return self.symbols[node]
            case Add():
                return self.make(sympy.Add, *parts)
            case Mul():
                return self.make(sympy.Mul, *parts)
            case Pow():
                return self.make(sympy.Pow, parts[0], sympy.Integer(node.exponent))
            case Call():
                return self.call(node.name, *parts)
            case Where():
                return self.where(node, *parts)
            case Tuple():
                return sympy.Tuple(*parts)
            case Integral():
                return self.integral(self.symbols[node.var], *parts)
            case Delta():
                return self.make(sympy.DiracDelta, parts[0])
            case Truth():
                return sympy.true if node.data else sympy.false
            case Compare():
                return self.comparison(node)
            case Not():
                return self.make(sympy.Not, parts[0])
            case And():
                return self.make(sympy.And, *parts)
            case Or():
                return self.make(sympy.Or, *parts)
            case _:
                raise OperandError(f"{type(node).__name__} has no form in SymPy", node, "convert the expression before it is eliminated")

    def number(self, value: float) -> Any:
        sympy = self.sympy
        if not math.isfinite(value):
            return sympy.nan if value != value else sympy.oo if value > 0 else -sympy.oo
        if self.exact or value.is_integer():
            return sympy.Rational(*value.as_integer_ratio())
        return sympy.Float(value, precision=53)

    def call(self, name: str, *parts: Any) -> Any:
        sympy = self.sympy
        match name:
            case "sqrt":
                return self.make(sympy.Pow, *parts, sympy.S.Half)
            case "root":
                return self.make(sympy.Pow, self.make(sympy.Abs, *parts), sympy.S.Half)
            case "magnitude":
                return self.make(sympy.Abs, *parts)
            case "ceil":
                return self.make(sympy.ceiling, *parts)
            case "round":
                return self.round(*parts)
            case "pow" | "mod" | "min" | "max":
                return self.make(getattr(sympy, name.capitalize()), *parts)
            case _:
                return self.make(getattr(sympy, name), *parts)

    def round(self, u: Any) -> Any:
        """⌊u + ½⌋, less 1 where (2u - 1)/4 is an integer: halves go to the even side."""
        sympy, make = self.sympy, self.make
        quarter = make(sympy.Mul, sympy.Rational(1, 4), make(sympy.Add, make(sympy.Mul, sympy.Integer(2), u), sympy.S.NegativeOne))
        below = make(sympy.Mul, sympy.S.NegativeOne, make(sympy.floor, quarter))
        nearest = make(sympy.floor, make(sympy.Add, u, sympy.S.Half))
        return make(sympy.Add, nearest, make(sympy.ceiling, quarter), below, sympy.S.NegativeOne)

    def integral(self, x: Any, body: Any, lo: Any, hi: Any) -> Any:
        """As it is in any case: SymPy's constructor would multiply out the branches of the integrand."""
        sympy = self.sympy
        limits = [sympy.Tuple(x, lo, hi)]
        if type(body) is sympy.Integral and len(body.args) <= _FLATTEN and all(inner.args[0] != x for inner in body.args[1:]):
            body, *inside = body.args
            limits = [*inside, *limits]
        return self.as_it_is(sympy.Integral, body, *limits)

    def comparison(self, node: Compare) -> Any:
        """g > 0, as b < a for g = a - b."""
        sympy, g = self.sympy, node.g
        if isinstance(g, Add) and len(g.children) == 2:
            a, b = g.children
            if isinstance(b, Mul) and len(b.children) == 2 and b.children[0] is MINUS_ONE:
                return self.make(sympy.Lt if node.strict else sympy.Le, self.done[b.children[1]], self.done[a])
        return self.make(sympy.Gt if node.strict else sympy.Ge, self.done[g], sympy.S.Zero)

    def where(self, node: Where, condition: Any, then: Any, otherwise: Any) -> Any:
        sympy = self.sympy
        named = _named(node)
        if named is not None:
            return self.make(getattr(sympy, named[0]), *(self.done[a] for a in named[1:]))
        branches = [(c, u) for c, u in ((node.condition, node.then), (ex.negation(node.condition), node.otherwise)) if u is not ZERO]
        as_products = len(branches) == 1 and _is_product(branches[0][0]) and branches[0][1] in self.finite
        if self.conditions == "heaviside" or (self.conditions == "auto" and as_products):
            return self.total([self.product(self.done[u], self.step(c)) for c, u in branches])
        if self.evaluate and not node.condition.has_integral:  # SymPy would move its branches out of the integral's scope
            return sympy.Piecewise((then, condition), (otherwise, True))
        pair = sympy.functions.elementary.piecewise.ExprCondPair
        pairs = (self.as_it_is(pair, then, condition), self.as_it_is(pair, otherwise, sympy.true))
        return self.as_it_is(sympy.Piecewise, *pairs)

    def total(self, terms: list[Any]) -> Any:
        return self.make(self.sympy.Add, *terms) if len(terms) > 1 else terms[0] if terms else self.sympy.S.Zero

    def product(self, *factors: Any) -> Any:
        mul, one = self.sympy.Mul, self.sympy.S.One
        flat = [a for f in factors for a in (f.args if type(f) is mul and len(f.args) <= _FLATTEN else (f,)) if a is not one]
        return self.make(mul, *flat) if len(flat) > 1 else flat[0] if flat else one

    def step(self, condition: Cond) -> Any:
        """The bracket of a condition, made of Heavisides."""
        stack = [condition]
        while stack:
            c = stack[-1]
            inside = () if isinstance(c, Compare) else cast("tuple[Cond, ...]", c.children)
            missing = [d for d in inside if d not in self.steps]
            if missing:
                stack.extend(missing)
                continue
            self.steps.setdefault(c, self.step_of(c, [self.steps[d] for d in inside]))
            stack.pop()
        return self.steps[condition]

    def step_of(self, c: Cond, parts: list[Any]) -> Any:
        sympy = self.sympy
        match c:
            case Compare():
                return self.make(sympy.Heaviside, self.done[c.g], sympy.Integer(not c.strict))
            case Not(operand=Compare(g=g, strict=strict)):
                opposite = self.make(sympy.Mul, sympy.S.NegativeOne, self.done[g])
                return self.make(sympy.Heaviside, opposite, sympy.Integer(strict))
            case Not():
                return self.complement(parts[0])
            case And():
                return self.product(*parts)
            case Or():
                return self.complement(self.product(*(self.complement(p) for p in parts)))
            case _:
                return sympy.Integer(c is ex.TRUE)

    def complement(self, step: Any) -> Any:
        sympy = self.sympy
        return self.make(sympy.Add, sympy.S.One, self.make(sympy.Mul, sympy.S.NegativeOne, step))


_FINITE = frozenset(("sin", "cos", "atan", "sinh", "cosh", "tanh", "exp", "floor", "ceil", "round", "magnitude", "root", "min", "max"))


def _is_finite(node: Node, finite: set[Node]) -> bool:
    """Is it a finite number for all parameters and variables, if the nodes below it that are in `finite` are?"""
    match node:
        case Const():
            return math.isfinite(node.data)
        case Pow() if node.exponent < 0:
            return node.base in finite and isinstance(node.base, Const) and node.base is not ZERO
        case Call(name="mod"):
            return node.children[0] in finite and isinstance(node.children[1], Const) and node.children[1] is not ZERO
        case Call() if node.name not in _FINITE:
            return False
        case _:
            return all([c in finite for c in node.children])


def _is_product(condition: Cond) -> bool:
    """Is its bracket a product of Heavisides?"""
    parts = condition.children if isinstance(condition, And) else (condition,)
    return all(isinstance(c.operand if isinstance(c, Not) else c, Compare) for c in parts)


def _named(node: Where) -> tuple[Any, ...] | None:
    """|u|, sign(u), a minimum or a maximum: SymPy's name for it and its arguments."""
    condition, then, otherwise = node.condition, node.then, node.otherwise
    if not isinstance(condition, Compare) or not condition.strict or condition.resolution is not None or node.has_delta:
        return None
    if then is condition.g and otherwise is ex.mul(MINUS_ONE, then):
        return "Abs", then
    if then is ONE and node is build.sign(condition.g):
        return "sign", condition.g
    if condition is ex.less(then, otherwise, strict=True):
        return "Min", then, otherwise
    if condition is ex.less(otherwise, then, strict=True):
        return "Max", then, otherwise
    return None


def from_sympy(s: Any, variables: Iterable[Any] = (), *, heaviside_at_zero: float | None = None) -> Any:
    """The expression of a SymPy form: a number, an expression, a condition, a tuple, or a matrix (the tuple of its rows).

    A symbol that an `Integral` binds becomes a variable. Other symbols become parameters, but those in `variables` (symbols, variables,
    names, or one string of names) become variables and stay free, for `teg.integral` to bind. A bound symbol whose name something else
    has gets a prime.

    Heaviside(u), ½ at 0 for SymPy, is the bracket [u > 0] where u depends on a variable and no DiracDelta is about: under an integral the
    value at 0 does not matter then. Elsewhere it is ½ at 0; a number `heaviside_at_zero` is taken instead of all this. Where no
    condition of a Piecewise holds its value is NaN, as it is for SymPy. Numbers that are no float64 are rounded to the nearest, but
    fractions stay quotients.

    Raises OperandError for what the language does not have, with SymPy's expression as `where`; BoundError for integrals without two
    finite bounds; NameClashError for two symbols of one name; MissingPackageError without SymPy.
    """
    sympy = _sympy()
    if isinstance(s, Expr | Cond | str):
        raise OperandError("from_sympy takes SymPy's expressions", s, "sympy.sympify reads text")
    try:
        root = sympy.Tuple(*(sympy.Tuple(*row) for row in s.tolist())) if isinstance(s, sympy.MatrixBase) else sympy.sympify(s)
        root = sympy.Tuple(*root) if isinstance(root, list | tuple) else root
    except (sympy.SympifyError, TypeError, AttributeError) as error:
        raise OperandError(f"{type(s).__name__} is no expression of SymPy: {s!r:.80}") from error
    if isinstance(variables, str):
        variables = variables.replace(",", " ").split()
    chosen = [variables] if isinstance(variables, Var | sympy.Symbol) else list(variables)
    if not all(isinstance(v, str | Var | sympy.Symbol) for v in chosen):
        raise ParameterError("variables= takes symbols, variables or names", chosen)
    wanted = frozenset(v if isinstance(v, str) else cast(str, v.name) for v in chosen)
    order = _sympy_postorder(root)
    at_zero = 0.5 if heaviside_at_zero is None and any(type(n) is sympy.DiracDelta for n in order) else heaviside_at_zero
    bound, names = _names(order, wanted, frozenset())
    result = _Reader(names, at_zero).read(order)
    outside = frozenset(x for x in bound if names[x] in result.free and x.name not in wanted)
    if not outside:
        return result
    _, names = _names(order, wanted, outside)  # a symbol is bound in one place and free in another: ∫₀ˣ f(x) dx
    places = {cast(Var, names[x]): cast(Expr, build.param(x.name)) for x in outside}
    return substitute(_Reader(names, at_zero, frozenset(places)).read(order), places)


def _names(order: list[Any], wanted: frozenset[str], outside: frozenset[Any]) -> tuple[list[Any], dict[Any, Expr]]:
    """The symbols that integrals bind, and what every symbol is; those in `outside` are free somewhere, and their names taken."""
    sympy = _sympy()
    bound = list(dict.fromkeys(limit[0] for n in order if isinstance(n, sympy.Integral) for limit in n.limits))
    among = frozenset(bound)
    free = [n for n in order if n.is_Symbol and (n not in among or n in outside)]
    taken: dict[str, Any] = {}
    names: dict[Any, Expr] = {}
    for symbol in free:
        if taken.setdefault(symbol.name, symbol) != symbol:
            raise NameClashError(f"two symbols are called {symbol.name!r}", symbol.name, "rename one, or give both the same assumptions")
        names[symbol] = build.var(symbol.name) if symbol.name in wanted else build.param(symbol.name)
    for symbol in bound:
        name = symbol.name
        while name in taken:
            name += "′"
        taken[name] = symbol
        names[symbol] = build.var(name)
    return bound, names


class _Reader:
    """SymPy's nodes to the language's, each once."""

    def __init__(self, names: Mapping[Any, Expr], at_zero: float | None, places: frozenset[Var] = frozenset()) -> None:
        self.sympy = _sympy()
        self.functions = _functions()
        self.names = names
        self.at_zero = at_zero  # of Heaviside(u); None: what from_sympy says
        self.places = places  # variables that may yet become parameters

    def read(self, order: list[Any]) -> Node:
        """The last of SymPy's nodes in postorder."""
        done: dict[int, Any] = {}
        for node in order:
            done[id(node)] = self.form(node, [done[id(part)] for part in _parts(node)])
        return cast(Node, done[id(order[-1])])

    def form(self, node: Any, parts: list[Any]) -> Node:
        sympy, kind = self.sympy, type(node)
        if node.is_Symbol:
            return self.names[node]
        if not node.args:
            return _leaf(node)
        if kind is sympy.Integral:
            return self.integral(node, *parts)
        if kind is sympy.Piecewise:
            result: Expr = ex.const(math.nan)
            for then, condition in zip(parts[-2::-2], parts[::-2], strict=True):
                result = build.where(condition, then, result)
            return result
        if kind is sympy.Heaviside:
            return self.heaviside(node, *map(ex.as_number, parts))
        if kind is sympy.Mul and node.args[0].is_Rational:
            return self.functions[kind](*parts[1:], parts[0])  # x/3 is a quotient, not a product with a rounded third
        if kind is sympy.Pow and node.exp.is_Rational:
            return ex.as_number(parts[0]) ** _nearest(node.exp)
        return self.functions[kind](*parts)

    def integral(self, node: Any, body: Expr, *bounds: Expr) -> Expr:
        for i, limit in enumerate(node.limits):
            body = build.integral(body, (self.names[limit[0]], bounds[2 * i], bounds[2 * i + 1]))
        return body

    def heaviside(self, node: Any, u: Expr, at_zero: Expr) -> Expr:
        if node.args[1] == self.sympy.S.Half:
            at_zero = ex.const(self.at_zero if self.at_zero is not None else 0.0 if u.free - self.places else 0.5)
        if at_zero is ZERO or at_zero is ONE:
            strict = at_zero is ZERO
            if isinstance(u, Mul) and len(u.children) == 2 and u.children[0] is MINUS_ONE and isinstance(u.children[1], Add):
                return build.bracket(~ex.positive(u.children[1], not strict))  # -(a - b), which SymPy does not write: it was a ~
            return build.bracket(ex.positive(u, strict))
        return build.where(u >= 0, build.where(u > 0, 1, at_zero), 0)


def _sympy_postorder(root: Any) -> list[Any]:
    """Every node of a SymPy expression once (by identity, for SymPy's == compares all of both), parts first; raises what says that the
    language has no such node."""
    order: list[Any] = []
    done: set[int] = set()
    opened: set[int] = set()
    stack = [root]
    while stack:
        node = stack[-1]
        if id(node) in done:
            stack.pop()
        elif id(node) in opened:
            done.add(id(node))
            order.append(node)
            stack.pop()
        else:
            opened.add(id(node))
            _check(node)
            stack.extend([part for part in reversed(_parts(node)) if id(part) not in done])
    return order


def _parts(node: Any) -> Sequence[Any]:
    """What a SymPy node is made of; of an integral the integrand, then its bounds."""
    sympy = _sympy()
    if type(node) is sympy.Integral:
        return [node.args[0], *(bound for limit in node.args[1:] for bound in limit.args[1:])]
    if type(node) is sympy.Piecewise:
        return [part for pair in node.args for part in pair.args]
    return cast("Sequence[Any]", node.args)


def _check(node: Any) -> None:
    """Raises what says that the language has no such node."""
    sympy = _sympy()
    if type(node) is sympy.Integral:
        for limit in node.args[1:]:
            x, *bounds = limit.args
            if not x.is_Symbol or len(bounds) != 2:
                raise BoundError("an integral needs a symbol and two bounds", _shown(node), "write Integral(e, (x, 0, 1))")
            if any(b in (sympy.oo, -sympy.oo, sympy.zoo, sympy.nan) for b in bounds if not b.args):
                hint = f"substitute, for instance {x} = tan(u) with u in (-π/2, π/2) and the factor 1 + tan(u)², or cut the tail off"
                raise BoundError(f"the bounds of {x} are not finite", _shown(node), hint)
    elif type(node) is sympy.DiracDelta and len(node.args) > 1 and node.args[1] != 0:
        raise OperandError("a derivative of a Dirac delta is not in the language", _shown(node), "differentiate with teg.diff")
    elif type(node) not in _functions() and not (isinstance(node, sympy.Basic) and _is_leaf(node)):
        unevaluated = isinstance(node, sympy.Derivative | sympy.Subs | sympy.Sum | sympy.Product | sympy.Limit)
        hint = "its .doit() may find a closed form" if unevaluated else ""
        raise OperandError(f"SymPy's {type(node).__name__} is not in the language", _shown(node), hint)


def _is_leaf(node: Any) -> bool:
    sympy = _sympy()
    numbers = sympy.Symbol | sympy.Rational | sympy.Float | sympy.NumberSymbol
    return isinstance(node, numbers) or node in (sympy.true, sympy.false, sympy.oo, -sympy.oo, sympy.nan)


def _shown(node: Any) -> object:
    """The expression, or its class where printing it would be long or deep: SymPy writes out what is shared."""
    stack, count = [(node, 0)], 0
    while stack:
        n, depth = stack.pop()
        count += 1
        if count > 300 or depth > 50:
            return f"{type(node).__name__}(…)"
        stack.extend((a, depth + 1) for a in getattr(n, "args", ()))
    return node


def _nearest(number: Any) -> float:
    """The float64 nearest to a number of SymPy's."""
    try:
        value = number.p / number.q if number.is_Rational else float(number.evalf(30) if number.is_NumberSymbol else number)
    except OverflowError:
        value = math.inf
    if math.isinf(value) and not number.is_infinite:
        raise OperandError("a number is beyond the range of float64", _shown(number))
    return cast(float, value)


def _leaf(node: Any) -> Expr | Cond:
    sympy = _sympy()
    if node is sympy.true or node is sympy.false:
        return ex.TRUE if node is sympy.true else ex.FALSE
    value = _nearest(node)
    if not node.is_Rational or node.is_Integer or value.as_integer_ratio() == (node.p, node.q):
        return ex.const(value)
    both_exact = all(n.bit_length() < 1024 and int(float(n)) == n for n in (node.p, node.q))
    return ex.div(ex.const(node.p), ex.const(node.q)) if both_exact else ex.const(value)


@cache
def _functions() -> dict[Any, Callable[..., Node]]:
    """What each of SymPy's functions is in the language, applied to converted arguments."""
    sympy = _sympy()
    of_numbers: dict[Any, Callable[..., Node]] = {
        sympy.Add: _sum,
        sympy.Mul: _product,
        sympy.Pow: lambda base, exponent: base**exponent,
        sympy.exp: build.exp,
        sympy.log: lambda u, base=None: build.log(u) if base is None else build.log(u) / build.log(base),
        sympy.sin: build.sin,
        sympy.cos: build.cos,
        sympy.tan: build.tan,
        sympy.sec: lambda u: 1 / build.cos(u),
        sympy.csc: lambda u: 1 / build.sin(u),
        sympy.cot: lambda u: build.cos(u) / build.sin(u),
        sympy.sinc: lambda u: build.where((u > 0) | (u < 0), build.sin(u) / u, 1),
        sympy.asin: build.asin,
        sympy.acos: build.acos,
        sympy.atan: build.atan,
        sympy.asec: lambda u: build.acos(1 / u),
        sympy.acsc: lambda u: build.asin(1 / u),
        sympy.acot: lambda u: build.atan(1 / u),
        sympy.atan2: build.atan2,
        sympy.sinh: build.sinh,
        sympy.cosh: build.cosh,
        sympy.tanh: build.tanh,
        sympy.sech: lambda u: 1 / build.cosh(u),
        sympy.csch: lambda u: 1 / build.sinh(u),
        sympy.coth: lambda u: 1 / build.tanh(u),
        sympy.asinh: _asinh,
        sympy.acosh: _acosh,
        sympy.atanh: lambda u: 0.5 * build.log((1 + u) / (1 - u)),
        sympy.asech: lambda u: _acosh(1 / u),
        sympy.acsch: lambda u: _asinh(1 / u),
        sympy.acoth: lambda u: 0.5 * build.log((u + 1) / (u - 1)),
        sympy.Abs: build.abs_,
        sympy.sign: build.sign,
        sympy.Min: build.minimum,
        sympy.Max: build.maximum,
        sympy.floor: build.floor,
        sympy.ceiling: lambda u: ex.call("ceil", u),
        sympy.frac: lambda u: build.mod(u, 1),
        sympy.Mod: build.mod,
        sympy.re: lambda u: u,
        sympy.conjugate: lambda u: u,
        sympy.UnevaluatedExpr: lambda u: u,
        sympy.DiracDelta: lambda u, order=None: build.delta(u),
        sympy.Lt: lambda a, b: a < b,
        sympy.Le: lambda a, b: a <= b,
        sympy.Gt: lambda a, b: a > b,
        sympy.Ge: lambda a, b: a >= b,
        sympy.Eq: lambda a, b: (a <= b) & (a >= b),
        sympy.Ne: lambda a, b: (a < b) | (a > b),
    }
    of_conditions: dict[Any, Callable[..., Node]] = {
        sympy.Not: ex.negation,
        sympy.And: ex.conjunction,
        sympy.Or: ex.disjunction,
        sympy.Nand: lambda *c: ~ex.conjunction(*c),
        sympy.Nor: lambda *c: ~ex.disjunction(*c),
        sympy.Xor: lambda *c: reduce(lambda a, b: (a & ~b) | (~a & b), c),
        sympy.Implies: lambda a, b: ~a | b,
        sympy.Equivalent: lambda *c: ex.conjunction(*c) | ~ex.disjunction(*c),
        sympy.ITE: lambda c, a, b: (c & a) | (~c & b),
    }
    table: dict[Any, Callable[..., Node]] = {sympy.Tuple: build.tuple_}
    for kinds, check in ((of_numbers, ex.as_number), (of_conditions, ex.as_condition)):
        for kind, f in kinds.items():
            table[kind] = lambda *parts, f=f, check=check: f(*map(check, parts))
    by_hand = (sympy.Integral, sympy.Piecewise, sympy.Heaviside)  # the reader's own
    return table | dict.fromkeys(by_hand, build.tuple_)


def _sum(*terms: Expr) -> Expr:
    return _remembering(Add, ex.add(*terms), terms)


def _product(*factors: Expr) -> Expr:
    numbers = [f for f in factors if isinstance(f, Const)]
    return _remembering(Mul, ex.mul(*factors), (*numbers, *(f for f in factors if not isinstance(f, Const))))


def _remembering(kind: type[Add | Mul], result: Expr, parts: tuple[Expr, ...]) -> Expr:
    """The result, or what was written if its parameters would vanish."""
    vanishes = isinstance(result, Const) or any(isinstance(p, Mul) and p.children[0] is ZERO for p in parts)
    return kind.make(None, parts) if vanishes and len(parts) > 1 and not all(isinstance(p, Const) for p in parts) else result


def _asinh(u: Expr) -> Expr:
    """log(u + √(u² + 1)), of |u|: for u < 0 the terms would cancel."""
    root = build.sqrt(u**2 + 1)
    return build.where(u > 0, build.log(u + root), -build.log(root - u))


def _acosh(u: Expr) -> Expr:
    return build.log(u + build.sqrt(u - 1) * build.sqrt(u + 1))


def jacobian_determinant(forward: Mapping[Var, Expr], variables: Sequence[Var]) -> Expr:
    """det ∂forward/∂variables: of x = r·cos(p), y = r·sin(p) by (r, p) it is r.

    Rows in the order of `forward`, columns in that of `variables`. The compiler differentiates, with the conditions of branches as
    constants; SymPy expands the determinant and simplifies it, numbers being exact fractions. Where this is too long for SymPy or holds
    integrals, SymPy fails or is not installed, or the result is longer, the determinant is as the compiler expands it. Raises
    ParameterError where the numbers of coordinates and variables differ, NotDifferentiableError for floor and mod of a variable.
    """
    if len(forward) != len(variables) or not variables:
        raise ParameterError(f"a Jacobian of {len(forward)} coordinates by {len(variables)} variables has no determinant")
    rows = [[slope(e, v) for v in variables] for e in forward.values()]
    plain = _expanded_determinant(rows)
    entries = ex.tuple_of(*(e for row in rows for e in row))
    if size(plain) == 1 or entries.has_integral or _written_out(entries) > _WRITTEN_OUT:
        return plain
    try:
        simple = _simplified_determinant(rows, entries)
    except Exception:  # of any kind: SymPy has no class for what its simplifiers cannot do, and the result is known without them
        return plain
    return simple if simple is not None and size(simple) <= size(plain) else plain


def _expanded_determinant(rows: Sequence[Sequence[Expr]]) -> Expr:
    """Row by row, by the set of columns taken: products share what they have in common, zeros cost nothing."""
    minors: dict[frozenset[int], Expr] = {frozenset(): ONE}
    for row in rows:
        terms: dict[frozenset[int], list[Expr]] = {}
        for taken, minor in minors.items():
            for column, entry in enumerate(row):
                if column not in taken and entry is not ZERO:
                    sign = -1.0 if sum(c > column for c in taken) % 2 else 1.0
                    terms.setdefault(taken | {column}, []).append(ex.mul(ex.const(sign), minor, entry))
        minors = {columns: ex.add(*parts) for columns, parts in terms.items()}
    return next(iter(minors.values()), ZERO)


def _simplified_determinant(rows: Sequence[Sequence[Expr]], entries: Tuple) -> Expr | None:
    sympy = _sympy()
    symbols = _symbols_of(entries, {})
    writer = _Writer(symbols, evaluate=True, conditions="piecewise", exact=True)
    determinant = sympy.Matrix([[writer.write(e) for e in row] for row in rows]).det(method="berkowitz")
    if sympy.count_ops(determinant) > _OPERATIONS:
        return None
    names = {symbol: cast(Expr, node) for node, symbol in symbols.items()}
    return cast(Expr, _Reader(names, None).read(_sympy_postorder(sympy.simplify(determinant))))
