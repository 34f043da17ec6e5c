"""Functions that are written once and applied many times: `teg.function`.

    e ::= … | f(e, …)         f = (name, formals, body); the application means the body with the arguments in the place of the formals
    d ::= … | ∂ᵢ∂ⱼ…f(e, …)    in derivatives: derivatives of the body by its inputs, at the arguments

A smooth body is *opaque* to the passes: they see an `Apply`, its number of arguments, its degree as a polynomial, and that its partial
derivatives are `Apply`s again. So the results of the passes (surfaces, breaks, rules) hold for every body of that signature: the
compiler puts a `Slot` in the place of each function, compiles, and binds the bodies at the end. A body that a pass must look into is
written out before the passes begin (`teg/passes/normalise/inline.py`).

The inputs of a function are its formals, then the other parameters of its body, by name. An `Apply` has one child for each input.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, cast

from teg.errors import NameClashError, OperandError, OptionError, ParameterError, ScopeError
from teg.ir.arrays import LEAVES, Ranged
from teg.ir.expr import Add, Call, Cond, Const, Expr, Mul, Param, Pow, Still, Tuple, Var, Where
from teg.ir.integral import Delta, Integral
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number

DEGREES = (2,)
"""The degrees that signatures distinguish: a body is a polynomial of at most this degree in its formals, or smooth.

There are few, so that few changes of a body change the signature.
"""

_ENTIRE = frozenset(("sin", "cos", "sinh", "cosh", "tanh", "exp", "expm1", "atan", "erf", "erfc"))
_BRANCHING = frozenset(("sqrt", "root", "log", "pow"))
_STEPS = frozenset(("floor", "ceil", "round", "mod"))


class Slot(Node):
    """The place of a function whose body is not known yet. Data are (number, formals, arity, degree)."""

    __slots__ = ()

    @property
    def number(self) -> int:
        return cast(int, self.data[0])

    @property
    def formal(self) -> int:
        """Returns the number of inputs that are formals."""
        return cast(int, self.data[1])

    @property
    def arity(self) -> int:
        return cast(int, self.data[2])

    @property
    def degree(self) -> int | None:
        """Returns an upper bound of the degree as a polynomial in the formals; None if the body is only known to be smooth."""
        return cast("int | None", self.data[3])

    @property
    def title(self) -> str:
        return f"function {self.number}"


class Function(Node):
    """A function of the language, made by `teg.function`. Call it with one argument for each formal.

        u, v = teg.vars("u v")
        wave = teg.function("wave", [u, v], teg.sin(u) * v)
        teg.evaluate(wave(t, 2.0), t=0.0)                   # 0.0

    Its data are (name, formals, inline), its child is the body.
    """

    __slots__ = ("_facts",)

    _facts: _Facts

    @property
    def title(self) -> str:
        return cast(str, self.data[0])

    @property
    def formals(self) -> tuple[Param | Var, ...]:
        return cast("tuple[Param | Var, ...]", self.data[1])

    @property
    def inline(self) -> bool | None:
        """Returns the option `inline` given to `teg.function`.

        teg.function("wave", [u], teg.sin(u), inline=True).inline  # True
        """
        return cast("bool | None", self.data[2])

    @property
    def body(self) -> Expr:
        return cast(Expr, self.children[0])

    @property
    def inputs(self) -> tuple[Param | Var, ...]:
        return self.facts.inputs

    @property
    def formal(self) -> int:
        return len(self.formals)

    @property
    def arity(self) -> int:
        return len(self.inputs)

    @property
    def degree(self) -> int | None:
        exact = self.facts.degree
        return None if exact is None else next((d for d in DEGREES if exact <= d), None)

    @property
    def facts(self) -> _Facts:
        if not hasattr(self, "_facts"):
            object.__setattr__(self, "_facts", _Facts(self))
        return self._facts

    @property
    def obstacle(self) -> str:
        """Returns the reason why the body has to be written out; "" if it is compiled by itself.

        teg.function("wave", [u], teg.sin(u)).obstacle      # ''
        """
        if self.inline is None:
            return self.facts.obstacle
        return "inline=True" if self.inline else ""

    def __call__(self, *arguments: object) -> Apply:
        """Returns the function applied to numbers or expressions. Raises OperandError for too few or too many arguments, or other types.

        str(teg.function("wave", [u], teg.sin(u))(2 * t))   # wave(2·t)
        """
        if len(arguments) != len(self.formals):
            names = ", ".join(f.name for f in self.formals)
            raise OperandError(f"{self.title}({names}) takes {len(self.formals)} arguments, and was given {len(arguments)}", self)
        inputs = tuple(as_number(a) for a in arguments)
        if deltas := [a for a in inputs if a.has_delta]:
            raise OperandError(f"a Dirac delta inside {self.title} has no meaning", deltas[0], "a delta may only be added and multiplied")
        return Apply.make((self, (0,) * self.arity), (*inputs, *self.inputs[self.formal :]))

    def __str__(self) -> str:
        return f"{self.title}({', '.join(f.name for f in self.formals)}) = {self.body}"

    def __repr__(self) -> str:
        return f"<teg.function {self!s:.200}>"


Callee = Function | Slot


class Apply(Call):
    """A function, or one of its derivatives, at its inputs. Data are (function or slot, order of the derivative by each input)."""

    __slots__ = ()

    @property
    def name(self) -> str:
        """Returns a name that no function of the language has."""
        return f"{self.callee.title} {self.derivative}"

    @property
    def callee(self) -> Callee:
        return cast(Callee, self.data[0])

    @property
    def derivative(self) -> tuple[int, ...]:
        return cast("tuple[int, ...]", self.data[1])

    @property
    def degree(self) -> int | None:
        """Returns an upper bound of the degree in the formals."""
        d = self.callee.degree
        return None if d is None else max(0, d - sum(self.derivative[: self.callee.formal]))

    @property
    def title(self) -> str:
        """Returns the name with a ∂ᵢ for every derivative by input i, counted from 1."""
        subscripts = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
        return "".join(f"∂{str(i).translate(subscripts)}" * k for i, k in enumerate(self.derivative, 1)) + self.callee.title


def apply_partials(node: Apply) -> list[Expr]:
    """Returns the derivatives by each input."""
    callee, order = node.data
    return [Apply.make((callee, (*order[:i], order[i] + 1, *order[i + 1 :])), node.children) for i in range(len(order))]


def functions_of(*roots: Node) -> list[Function]:
    """Returns the functions applied in expressions, in order of first appearance. Functions inside of their bodies are not included."""
    return list(dict.fromkeys(n.callee for n in postorder(roots) if isinstance(n, Apply) and isinstance(n.callee, Function)))


def function(name: str, args: Sequence[Param | Var], body: object, *, inline: bool | None = None) -> Function:
    """Returns a function of the language, differentiated and compiled once.

        shade = teg.function("shade", [u, v], u * teg.exp(-v))
        teg.evaluate(teg.integral(shade(x, t), (x, 0, 1)), t=0.0)  # 0.5

    `args` are the formal names, teg.param or teg.var objects. Inside of the body they stand for the arguments; outside they keep their
    usual meaning. Other parameters of the body stay parameters of the program; other variables must be bound in it. An application means
    the body with the arguments substituted, derivatives of any order included.

    A smooth body is compiled by itself and linked. A program with another body of the same signature (number of formals, other
    parameters, polynomial of degree 2 or not) reuses the rest of the compilation, as long as one of its evaluators is alive. A body with
    conditions, kinks, steps, integrals, or a place where it may be singular is written out where it is applied; so is a body in a
    condition or a bound (`teg.explain` says which). `inline=True` always writes it out: the fastest code, and the longest compilation.
    `inline=False` does not write it out because of its own nodes: the caller promises that the body is smooth where it is evaluated.

    Raises OperandError for a name that is not a text or a body that is not a number, ParameterError for formals that are neither
    parameters nor variables, NameClashError for a repeated formal, ScopeError for a variable in the body that nothing binds.
    """
    if not isinstance(name, str) or not name:
        raise OperandError(f"a function is named by a string that is not empty, not by {name!r:.80}")
    if isinstance(args, Expr) or not isinstance(args, Collection):
        raise ParameterError(f"the arguments of {name} are a list of parameters or variables", args, 'teg.function("f", [u, v], body)')
    for formal in args:
        if not isinstance(formal, Param | Var):
            raise ParameterError(f"{formal!r:.80} is not a name for an argument of {name}", None, 'teg.param("u") or teg.var("u")')
    formals = tuple(args)
    if len({f.name for f in formals}) != len(formals):
        raise NameClashError(f"an argument of {name} is named twice", None, ", ".join(f.name for f in formals))
    if inline not in (None, True, False):
        raise OptionError(f"inline={inline!r:.80} is not known", None, "None, True or False")
    if isinstance(body, Tuple):
        raise OperandError(f"the body of {name} is a tuple", body, "make one function an entry")
    e = as_number(body)
    if any(isinstance(n, (*LEAVES, Ranged)) for n in postorder([e])):
        raise OperandError(f"the body of {name} holds an array or a sum", e, "make the entries arguments: f(V[i, 0], V[i, 1])")
    if e.has_delta:
        raise OperandError(f"the body of {name} holds a Dirac delta", e, "a delta may only be added and multiplied")
    if loose := sorted(v.name for v in e.free if v not in formals):
        raise ScopeError(f"a variable of the body of {name} is neither an argument nor bound: {', '.join(loose)}", e, "make it an argument")
    if any(isinstance(n, Still) for n in postorder([e])):
        raise OperandError(f"the body of {name} holds teg.stop_delta", e, "apply it to the result: teg.stop_delta(f(…))")
    made = Function.make((name, formals, inline), (e,))
    if clash := sorted({f.name for f in formals} & {p.name for p in made.inputs[made.formal :]}):
        raise NameClashError(f"{clash[0]!r} is an argument of {name} and a parameter in its body", e, "rename one of them")
    return made


class _Facts:
    """Properties of a body: its obstacle, its degree and that of its exponents."""

    def __init__(self, function: Function) -> None:
        order = cast("list[Any]", postorder([function.body]))
        others = {n for n in order if isinstance(n, Param) and n not in function.formals}
        self.inputs = (*function.formals, *sorted(others, key=lambda p: p.name))
        degrees = degrees_in(order, set(function.formals))
        self.degree = degrees[function.body]
        self.exponent = 0
        """The largest degree of the polynomials that stand in an exponential."""
        self.obstacle = ""
        signs = _signs(order)
        for node in order:
            if degrees[node] == 0:  # the same at all arguments
                continue
            problem = _problem(node, signs)
            self.obstacle = self.obstacle or problem
            if isinstance(node, Call) and node.name == "exp":
                self.exponent = max(self.exponent, degrees[node.children[0]] or 0)
            elif isinstance(node, Apply) and isinstance(node.callee, Function):
                most = max((degrees[c] or 0 for c in node.children), default=0)
                self.exponent = max(self.exponent, node.callee.facts.exponent * most)


def _problem(node: Node, signs: dict[Node, int]) -> str:
    """Returns the reason why a pass has to look into this part of a body; "" if there is none."""
    match node:
        case Cond() | Where():
            return "it has a condition"
        case Integral():
            return "it holds an integral"
        case Delta():
            return "it holds a delta"
        case Apply(callee=Function() as inner):
            return f"it applies {inner.title}: {inner.obstacle}" if inner.obstacle and inner.inline is not True else inner.facts.obstacle
        case Pow() if node.exponent < 0 and signs[node.base] < _POSITIVE:
            return "it may divide by 0"
        case Call() if node.name in _STEPS:
            return f"it has steps: {node.name}"
        case Call(name="log1p") if signs[node.children[0]] >= _NOT_NEGATIVE:
            return ""
        case Call() if node.name in _BRANCHING and signs[node.children[0]] < _POSITIVE:
            return f"it may be singular: {node.name}"
        case Call() if node.name in _ENTIRE or node.name in _BRANCHING or isinstance(node, Apply):
            return ""
        case Call():
            return f"it may be singular: {node.name}"
        case _:
            return ""


_UNKNOWN, _NOT_NEGATIVE, _POSITIVE = range(3)


def _signs(order: Sequence[Any]) -> dict[Node, int]:
    """Returns the nodes that are certainly positive, or certainly not negative."""
    signs: dict[Node, int] = {}
    for node in order:
        parts = [signs[c] for c in node.children]
        sign = _UNKNOWN
        match node:
            case Const():
                sign = _POSITIVE if node.data > 0 else _NOT_NEGATIVE if node.data == 0 else _UNKNOWN
            case Add() if min(parts) >= _NOT_NEGATIVE:
                sign = max(parts)
            case Mul():
                sign = min(parts)
            case Pow():
                sign = parts[0] if parts[0] == _POSITIVE else _NOT_NEGATIVE if node.exponent % 2 == 0 else parts[0]
            case Call() if node.name in ("exp", "cosh", "erfc"):
                sign = _POSITIVE
            case Call() if node.name in ("sqrt", "root", "pow", "magnitude"):
                sign = _POSITIVE if parts[0] == _POSITIVE else _NOT_NEGATIVE
            case _:
                pass
        signs[node] = sign
    return signs


def degrees_in(order: Sequence[Any], symbols: Collection[Node]) -> dict[Node, int | None]:
    """Returns upper bounds of the degrees of nodes, in postorder, as polynomials in symbols (cancellation is ignored); None for other
    nodes."""
    degrees: dict[Node, int | None] = {}
    for node in order:
        parts = [degrees[c] for c in node.children]
        degree: int | None = None
        if node in symbols:
            degree = 1
        elif all(d == 0 for d in parts):
            degree = 0
        elif None not in parts:
            known = cast("list[int]", parts)
            match node:
                case Add():
                    degree = max(known)
                case Mul():
                    degree = sum(known)
                case Pow() if node.exponent > 0:
                    degree = node.exponent * known[0]
                case Apply() if node.degree is not None and not any(known[node.callee.formal :]):
                    inner = node.callee.facts.degree if isinstance(node.callee, Function) else node.degree
                    degree = (inner or 0) * max(known)
                case _:
                    pass
        degrees[node] = degree
    return degrees
