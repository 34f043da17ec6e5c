"""The expression language: numbers, parameters, variables, arithmetic, functions, conditions, `where`, tuples.

    e ::= c | p | x | e + … + e | e · … · e | e^k | f(e, …) | where(b, e, e) | (e, …, e)          (binders stand in integral.py)
    b ::= g > 0 | g >= 0 | ~b | b & … & b | b | … | b | true | false

A comparison a < b is kept as the atom g = b - a > 0. The functions in lower case (`add`, `mul`, `power`, `call`, `where`, …) build nodes
and apply the simplifications that cost nothing to detect: constants, neutral elements, equal terms, a bracket as a factor. They neither
reorder nor re-associate sums, so a program is evaluated as the user wrote it. The operators of `Expr` call these functions, but do not
drop operands: `t - t` still has the parameter t, because it is an argument of the program.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Iterator
from numbers import Real
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, cast

from teg.errors import ConditionError, DeltaError, OperandError
from teg.ir.node import Node
from teg.numerics.error_function import inverse_erf, inverse_erfc

if TYPE_CHECKING:
    from decimal import Decimal
    from fractions import Fraction

    import numpy as np

    from teg.ir.index import Index

Operand: TypeAlias = "Expr | Index | float | np.floating[Any] | np.integer[Any] | Fraction | Decimal"
"""The types of numbers: expressions, indices, and real numbers of Python and NumPy."""

_FLATTEN = 8  # a product inside a product is merged while it is this short: longer ones would make chains quadratic


_GUARDS = 4  # the largest number of different branches that are kept together as one


class Expr(Node):
    """A number-valued expression, for annotations and `isinstance`. Expressions are made by operators and by the functions of `teg`.

        isinstance(t + 1, teg.Expr)                         # True
        (t + 1) is (t + 1)                                  # True

    They are immutable; equal ones are one object, so `==` is identity, and they can be keys of a dict.
    """

    __slots__ = ()

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: object, **options: object) -> Expr | Cond:
        """Returns the result of arithmetic with NumPy scalars. Raises OperandError for NumPy's functions, which do not
        accept expressions."""
        operate = _NUMPY_OPERATORS.get(ufunc.__name__)
        if operate is not None and method == "__call__" and not options:
            return cast("Expr | Cond", operate(*(as_number(i) if not isinstance(i, Expr) else i for i in inputs)))
        raise OperandError(f"numpy.{ufunc.__name__} does not know expressions", self, f"use teg.{ufunc.__name__}, or the operators")

    def __add__(self, other: Operand) -> Expr:
        return _binary(self, other, add)

    def __radd__(self, other: Operand) -> Expr:
        return _binary(other, self, add)

    def __sub__(self, other: Operand) -> Expr:
        return _binary(self, other, sub)

    def __rsub__(self, other: Operand) -> Expr:
        return _binary(other, self, sub)

    def __mul__(self, other: Operand) -> Expr:
        return _binary(self, other, mul)

    def __rmul__(self, other: Operand) -> Expr:
        return _binary(other, self, mul)

    def __truediv__(self, other: Operand) -> Expr:
        return _binary(self, other, div)

    def __rtruediv__(self, other: Operand) -> Expr:
        return _binary(other, self, div)

    def __mod__(self, other: Operand) -> Expr:
        return entrywise(lambda a, b: call("mod", a, b), self, other)

    def __rmod__(self, other: Operand) -> Expr:
        return entrywise(lambda a, b: call("mod", a, b), other, self)

    def __floordiv__(self, other: Operand) -> Expr:
        return entrywise(lambda u: call("floor", u), self / other)

    def __rfloordiv__(self, other: Operand) -> Expr:
        return entrywise(lambda u: call("floor", u), other / self)

    def __pow__(self, other: Operand) -> Expr:
        return _binary(self, other, power)

    def __rpow__(self, other: Operand) -> Expr:
        return _binary(other, self, power)

    def __neg__(self) -> Expr:
        return _binary(MINUS_ONE, self, mul)

    def __pos__(self) -> Expr:
        return self

    def __abs__(self) -> Expr:
        return entrywise(absolute, self)

    def __lt__(self, other: Operand) -> Cond:
        return less(self, other, strict=True)

    def __le__(self, other: Operand) -> Cond:
        return less(self, other, strict=False)

    def __gt__(self, other: Operand) -> Cond:
        return less(other, self, strict=True)

    def __ge__(self, other: Operand) -> Cond:
        return less(other, self, strict=False)

    def __bool__(self) -> NoReturn:
        raise ConditionError(
            "an expression has no truth value while the program is being written",
            self,
            "use teg.where(condition, a, b) instead of if/else",
        )

    def __float__(self) -> float:
        if isinstance(self, Const):
            return self.data  # type: ignore[no-any-return]
        hint = "functions of expressions are those of teg: teg.exp for math.exp; a number is given by teg.evaluate(e, {parameter: value})"
        raise OperandError("an expression is not a number yet", self, hint)

    def __int__(self) -> int:
        return int(float(self))

    if not TYPE_CHECKING:  # type checkers report it themselves

        def __call__(self, *_: object, **__: object) -> NoReturn:
            raise OperandError("an expression is not a function", self, "f = teg.compile(e), then f(t=0.5); or teg.evaluate(e, t=0.5)")

    def __round__(self, digits: int | None = None) -> Expr:
        if digits is not None:
            raise OperandError("an expression is rounded to integers only", self, "write teg.round(e * 100) / 100 for two digits")
        return entrywise(lambda u: call("round", u), self)

    def __floor__(self) -> Expr:
        return entrywise(lambda u: call("floor", u), self)

    def __ceil__(self) -> Expr:
        return entrywise(lambda u: call("ceil", u), self)

    def _is_no_condition(self, *_: object) -> NoReturn:
        raise ConditionError("& joins conditions, not numbers", self, "write (a < b) & (c < d), with the brackets")

    if not TYPE_CHECKING:
        __and__ = __rand__ = __or__ = __ror__ = _is_no_condition

    def __invert__(self) -> NoReturn:
        raise ConditionError("~ negates conditions, not numbers", self, "write ~(a < b), with the brackets")

    def __getitem__(self, index: object) -> Expr:
        raise OperandError("only tuples and arrays can be indexed", self)

    def __iter__(self) -> Iterator[Expr]:
        raise OperandError("only tuples can be iterated over", self)


class Const(Expr):
    """A number."""

    __slots__ = ()


class Param(Expr):
    """A parameter, made by `teg.param`. Derivatives are taken by parameters. `name` is its name.

    teg.param("t").name                                 # 't'
    """

    __slots__ = ()

    @property
    def name(self) -> str:
        return self.data  # type: ignore[no-any-return]


class Still(Param):
    """A parameter that does not move: it has the value of the parameter and the derivative 0 (`teg.ir.still`)."""

    __slots__ = ()


class Var(Expr):
    """A variable of integration, made by `teg.var`, and bound by an integral. `name` is its name.

    sorted(v.name for v in (x * y * t).free)            # ['x', 'y']
    """

    __slots__ = ()

    @property
    def name(self) -> str:
        return self.data  # type: ignore[no-any-return]

    def _free_variables(self) -> frozenset[Any]:
        return frozenset((self,))


class Add(Expr):
    """a + b + …"""

    __slots__ = ()
    children: tuple[Expr, ...]


class Mul(Expr):
    """a · b · …; a number comes first."""

    __slots__ = ()
    children: tuple[Expr, ...]


class Pow(Expr):
    """base^k with an integer k, neither 0 nor 1."""

    __slots__ = ()

    @property
    def base(self) -> Expr:
        return self.children[0]  # type: ignore[return-value]

    @property
    def exponent(self) -> int:
        return self.data  # type: ignore[no-any-return]


class Call(Expr):
    """A function of the language: its name and its arguments."""

    __slots__ = ()
    children: tuple[Expr, ...]

    @property
    def name(self) -> str:
        return self.data  # type: ignore[no-any-return]


class UncountedFloor(Call):
    """floor(u) with more steps than are written out one by one."""

    __slots__ = ()


class Where(Expr):
    """`then` where the condition holds, else `otherwise`. The other value never matters, even if it is NaN."""

    __slots__ = ()

    @property
    def condition(self) -> Cond:
        return self.children[0]  # type: ignore[return-value]

    @property
    def then(self) -> Expr:
        return self.children[1]  # type: ignore[return-value]

    @property
    def otherwise(self) -> Expr:
        return self.children[2]  # type: ignore[return-value]


class Tuple(Expr):
    """Several expressions evaluated together, made by `teg.tuple`. It has a length, entries `e[0]`, and can be iterated over.

        str(2 * teg.tuple(t, a) + 1)                        # (2·t + 1, 2·a + 1)

    Arithmetic and functions work entry by entry; + does not join tuples. Raises OperandError for tuples of different lengths.
    """

    __slots__ = ()
    children: tuple[Expr, ...]

    def __getitem__(self, index: object) -> Expr:
        if not isinstance(index, int):
            raise OperandError("a tuple is indexed by an integer", self)
        if not -len(self.children) <= index < len(self.children):
            raise IndexError(f"a tuple of {len(self.children)} has no entry {index}")
        return self.children[index]

    def __len__(self) -> int:
        return len(self.children)

    def __iter__(self) -> Iterator[Expr]:
        return iter(self.children)


class Cond(Node):
    """A condition, made by `< <= > >=` and combined by `& | ~`. `teg.bracket` and `teg.where` take one.

        str((x < t) & ~(x < 0))                             # x < t & ~(x < 0)

    It has no truth value and is no number: `if`, `and`, `not`, `max` and arithmetic raise ConditionError.
    """

    __slots__ = ()

    def __and__(self, other: Cond) -> Cond:
        return conjunction(self, as_condition(other))

    def __rand__(self, other: Cond) -> Cond:
        return conjunction(as_condition(other), self)

    def __or__(self, other: Cond) -> Cond:
        return disjunction(self, as_condition(other))

    def __ror__(self, other: Cond) -> Cond:
        return disjunction(as_condition(other), self)

    def __invert__(self) -> Cond:
        return negation(self)

    def __bool__(self) -> NoReturn:
        raise ConditionError(
            "a condition has no truth value while the program is being written",
            self,
            "write (a < x) & (x < b) for a < x < b; & | ~ for and, or, not; teg.where(c, a, b) for if/else; teg.minimum, teg.maximum for "
            "Python's min, max",
        )

    def _is_no_number(self, *_: object) -> NoReturn:
        raise ConditionError("a condition is not a number", self, "teg.bracket(condition) is 1 where it holds, else 0")

    if not TYPE_CHECKING:  # type checkers report these themselves
        __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _is_no_number
        __pow__ = __rpow__ = __neg__ = __pos__ = __abs__ = __lt__ = __le__ = __gt__ = __ge__ = __float__ = _is_no_number
    __array_ufunc__ = None


class Truth(Cond):
    """true or false."""

    __slots__ = ()


class Compare(Cond):
    """The atom g > 0 (`strict`) or g >= 0.

    The optional second child is the *resolution* of a tie: it counts where g is 0 to rounding and another surface runs through the same
    point. It is the truth value if the surfaces are moved apart in one order; its negation is the value in the reversed order
    (`teg.analysis.surfaces`).
    """

    __slots__ = ()

    @property
    def strict(self) -> bool:
        return self.data[0]  # type: ignore[no-any-return]

    @property
    def rivals(self) -> tuple[str, str] | None:
        """Returns the two surfaces of a tie, printed, if the atom can meet one."""
        return self.data[1]  # type: ignore[no-any-return]

    @property
    def g(self) -> Expr:
        return self.children[0]  # type: ignore[return-value]

    @property
    def resolution(self) -> Cond | None:
        return cast(Cond, self.children[1]) if len(self.children) == 2 else None


class Not(Cond):
    __slots__ = ()

    @property
    def operand(self) -> Cond:
        return self.children[0]  # type: ignore[return-value]


class And(Cond):
    __slots__ = ()
    children: tuple[Cond, ...]


class Or(Cond):
    __slots__ = ()
    children: tuple[Cond, ...]


_NUMPY_OPERATORS: dict[str, Callable[[Any, Any], object]] = {
    "add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv, "true_divide": operator.truediv,
    "power": operator.pow, "floor_divide": operator.floordiv, "remainder": operator.mod, "less": operator.lt, "less_equal": operator.le,
    "greater": operator.gt, "greater_equal": operator.ge,
}  # fmt: skip

FUNCTIONS: dict[str, Callable[..., float]] = {
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan,
    "atan2": math.atan2, "sinh": math.sinh, "cosh": math.cosh, "tanh": math.tanh, "exp": math.exp, "log": math.log,
    "erf": math.erf, "erfc": math.erfc, "expm1": math.expm1, "log1p": math.log1p, "sqrt": math.sqrt,
    "pow": math.pow, "floor": lambda x: float(math.floor(x)), "ceil": lambda x: float(math.ceil(x)),
    "round": lambda x: float(round(x)), "mod": lambda x, y: x - y * math.floor(x / y),
    "erfinv": inverse_erf, "erfcinv": inverse_erfc, "magnitude": abs, "root": lambda x: math.sqrt(abs(x)), "min": min, "max": max,
}  # fmt: skip
"""The functions of the language, and six that only the compiler uses.

`erfinv` and `erfcinv` are the inverses of erf and erfc, for the roots of conditions.
`magnitude` is |u| without a surface at u = 0, for weights that cannot vanish. `root` is √u where u >= 0, and a number, not NaN, where
rounding takes u below 0. `min` and `max` serve interval bounds.
"""

_SINGULAR = frozenset(("sqrt", "log", "log1p", "pow", "asin", "acos"))


def const(value: float) -> Const:
    """Returns a number as an expression."""
    shared = _UNITS.get(value)
    return Const.make(float(value) + 0.0, ()) if shared is None else shared


ZERO, ONE, MINUS_ONE = (Const.make(value, ()) for value in (0.0, 1.0, -1.0))
_UNITS = {0.0: ZERO, 1.0: ONE, -1.0: MINUS_ONE}  # -0.0 is 0.0 as well
TRUE, FALSE = Truth.make(True, ()), Truth.make(False, ())


def as_number(value: object) -> Expr:
    """Returns the expression for a value that a user gives as a number."""
    if isinstance(value, Expr):
        if isinstance(value, Tuple):
            raise OperandError("a tuple stands where one number is expected", value, "use its entries: e[0], e[1], …")
        return value
    if isinstance(value, Cond):
        value._is_no_number()
    if isinstance(value, Node) and hasattr(value, "_as_expression"):  # an index, a node of a later module
        return cast(Expr, value._as_expression())
    if isinstance(value, bool):
        raise ConditionError(
            f"{value} is a Python truth value, not an expression",
            None,
            "== compares by identity; write conditions with < <= > >=",
        )
    if isinstance(value, Real) or (hasattr(value, "__float__") and getattr(value, "ndim", None) == 0):
        return const(float(cast(Any, value)))
    if isinstance(value, tuple | list):
        kind = type(value).__name__
        raise OperandError(
            f"a Python {kind} is not an expression: {value!r:.80}", None, "several expressions are one by teg.tuple(e1, e2, …)"
        )
    raise OperandError(
        f"{type(value).__name__} is not a number or an expression: {value!r:.80}",
        None,
        "build programs from numbers, teg.param, teg.var; arrays of values are given when the compiled function is called",
    )


def entrywise(build: Callable[..., Expr], *operands: object) -> Expr:
    """Returns the result of an operation on numbers; on tuples, entry by entry. A number goes with every entry of a tuple.

    Raises OperandError for tuples of different lengths.
    """
    tuples = [operand for operand in operands if isinstance(operand, Tuple)]
    if not tuples:
        return build(*map(as_number, operands))
    if len({len(operand) for operand in tuples}) > 1:
        lengths = " and ".join(str(len(operand)) for operand in tuples)
        raise OperandError(f"tuples of {lengths} entries do not go together", tuples[0], "an operation on tuples is entry by entry")
    columns = (operand.children if isinstance(operand, Tuple) else (operand,) * len(tuples[0]) for operand in operands)
    return tuple_of(*(entrywise(build, *row) for row in zip(*columns, strict=True)))


def as_condition(value: object) -> Cond:
    """Returns the condition for a value that a user gives as one. Raises ConditionError, which says what to write instead."""
    if isinstance(value, Cond):
        return value
    if isinstance(value, bool):
        raise ConditionError(
            f"{value} is a Python truth value, not a condition of the program",
            None,
            "== compares expressions by identity; conditions are written with < <= > >= on variables and parameters",
        )
    raise ConditionError(
        "a condition was expected",
        value,
        "write a comparison such as x < t; teg.bracket(condition) turns one into 0 or 1",
    )


def _binary(a: object, b: object, build: Callable[[Expr, Expr], Expr]) -> Expr:
    """Returns the result of a user's operator: simplified, but never to a number that lacks the operands; of tuples entry by entry."""
    if isinstance(a, Tuple) or isinstance(b, Tuple):
        return entrywise(lambda left, right: _binary(left, right, build), a, b)
    left, right = as_number(a), as_number(b)
    result = build(left, right)
    constants = isinstance(left, Const) and isinstance(right, Const)
    if not constants and (isinstance(result, Const) or _is_nothing(left) or _is_nothing(right)):
        return _as_written(left, right, build)
    return result


def _is_nothing(e: Expr) -> bool:
    return isinstance(e, Mul) and e.children[0] is ZERO


def _as_written(a: Expr, b: Expr, build: Callable[[Expr, Expr], Expr]) -> Expr:
    """Returns the plain node of an operation that simplification would drop. Its parameters remain arguments of the program."""
    if build is power:
        return Add.make(None, (ONE, Mul.make(None, (ZERO, a)))) if b is ZERO else build(a, b)
    if build is sub:
        return Add.make(None, (a, Mul.make(None, (MINUS_ONE, b))))
    if build is div:
        return Mul.make(None, (a, Pow.make(-1, (b,))))
    return (Add if build is add else Mul).make(None, (a, b))


def _split(term: Mul) -> tuple[float, Expr]:
    """Returns the numerical factor of a product, and the product of the other factors."""
    number = term.children[0]
    if not isinstance(number, Const):
        return 1.0, term
    others = term.children[1:]
    return number.data, others[0] if len(others) == 1 else Mul.make(None, others)


def add(*terms: Expr) -> Expr:
    """Returns the sum, in the order given. Constants, equal terms, and branches on one condition are collected."""
    constant = 0.0
    parts: dict[Expr, float] = {}
    branches: dict[Cond, list[Where]] = {}
    for term in terms:
        if isinstance(term, Const):
            constant += term.data
        elif isinstance(term, Mul):
            coefficient, product = _split(term)
            parts[product] = parts.get(product, 0.0) + coefficient
        else:
            parts[term] = parts.get(term, 0.0) + 1.0
            if isinstance(term, Where):
                branches.setdefault(term.condition, []).append(term)
    for condition, same in branches.items():
        if len(same) > 1:
            for term in same:
                parts.pop(term, None)
            merged = where(condition, add(*(w.then for w in same)), add(*(w.otherwise for w in same)))
            if merged is not ZERO:
                parts[merged] = parts.get(merged, 0.0) + 1.0
    kept = [mul(const(c), product) if c != 1.0 else product for product, c in parts.items() if c != 0.0]
    if constant != 0.0:
        kept.append(const(constant))
    if not kept:
        return ZERO
    return kept[0] if len(kept) == 1 else Add.make(None, tuple(kept))


def guarded_sum(terms: Iterable[Expr]) -> Expr:
    """Returns the sum of cotangents.

    If all terms are branches, so is the sum: its factors cannot leak a NaN where no branch is taken.
    """
    kept = [t for t in terms if t is not ZERO]
    guarded = [_guarded(t) for t in kept]
    conditions = list(dict.fromkeys(c for c, _ in guarded))
    if not kept or len(conditions) > _GUARDS or TRUE in conditions:
        return add(*kept)
    if len(conditions) == 1:
        return where(conditions[0], add(*(u for _, u in guarded)), ZERO)
    sets = [dict.fromkeys(c.children if isinstance(c, And) else (c,)) for c in conditions]
    common = [c for c in sets[0] if all(c in s for s in sets[1:])]
    rests = {c: conjunction(*(p for p in s if p not in common)) for c, s in zip(conditions, sets, strict=True)}
    total = add(*(where(rests[c], u, ZERO) for c, u in guarded))
    return where(conjunction(*common, disjunction(*rests.values())), total, ZERO)


def _guarded(term: Expr) -> tuple[Cond, Expr]:
    """Returns a term as where(c, u, 0), given that, where(~c, 0, u), or one of these inside another. c is TRUE if the term is no branch."""
    conditions: list[Cond] = []
    while isinstance(term, Where) and (term.otherwise is ZERO or term.then is ZERO):
        if term.otherwise is ZERO:
            conditions.append(term.condition)
            term = term.then
        else:
            conditions.append(negation(term.condition))
            term = term.otherwise
    return conjunction(*conditions), term


def sub(a: Expr, b: Expr) -> Expr:
    """Returns a - b."""
    return add(a, mul(MINUS_ONE, b))


def div(a: Expr, b: Expr) -> Expr:
    """Returns a / b."""
    return mul(a, power(b, MINUS_ONE))


def mul(*factors: Expr) -> Expr:
    """Returns the product. A factor where(b, u, 0) takes the whole product into its branch."""
    coefficient = 1.0
    powers: dict[Expr, int] = {}
    conditions: list[Cond] = []
    stack = list(reversed(factors))
    while stack:
        factor = stack.pop()
        if isinstance(factor, Const):
            coefficient *= factor.data
        elif isinstance(factor, Mul) and len(factor.children) <= _FLATTEN:
            stack.extend(reversed(factor.children))
        elif isinstance(factor, Where) and factor.otherwise is ZERO:
            conditions.append(factor.condition)
            stack.append(factor.then)
        elif isinstance(factor, Where) and factor.then is ZERO:
            conditions.append(negation(factor.condition))
            stack.append(factor.otherwise)
        elif isinstance(factor, Pow):
            powers[factor.base] = powers.get(factor.base, 0) + factor.exponent
        else:
            powers[factor] = powers.get(factor, 0) + 1
    if coefficient == 0.0:
        return ZERO
    kept: list[Expr] = [_integer_power(base, k) for base, k in powers.items() if k != 0]
    if coefficient != 1.0 or not kept:
        kept.insert(0, const(coefficient))
    product = kept[0] if len(kept) == 1 else Mul.make(None, tuple(kept))
    return where(conjunction(*conditions), product, ZERO) if conditions else product


def _integer_power(base: Expr, k: int) -> Expr:
    return base if k == 1 else Pow.make(k, (base,))


def power(base: Expr, exponent: Expr) -> Expr:
    """Returns base^exponent: an integer power, a square root, or the real power of a positive base."""
    if isinstance(exponent, Const):
        k = exponent.data
        if k == 0.0:
            return ONE
        if k == 1.0:
            return base
        if float(k).is_integer() and abs(k) < 2**31:
            return integer_power(base, int(k))
        if k == 0.5:
            return call("sqrt", base)
        if k == -0.5:
            return integer_power(call("sqrt", base), -1)
    return call("pow", base, exponent)


def integer_power(base: Expr, k: int) -> Expr:
    """Returns base^k."""
    if k == 0:
        return ONE
    if k == 1:
        return base
    if isinstance(base, Const):
        if base.data != 0.0 and (k > 0 or abs(math.frexp(base.data)[0]) == 0.5):  # 1/3 is not a binary number: it is divided, as written
            try:
                return const(base.data**k)
            except OverflowError:
                pass
        elif base.data == 0.0 and k > 0:
            return ZERO
    if isinstance(base, Call) and base.name in ("sqrt", "root") and k % 2 == 0:
        return integer_power(base.children[0], k // 2)
    if isinstance(base, Pow) and (base.exponent == -1 or k > 0):
        return integer_power(base.base, base.exponent * k)
    if isinstance(base, Mul) and base.children[0] is MINUS_ONE and k % 2 == 0:
        return integer_power(mul(*base.children[1:]), k)
    if isinstance(base, Where):
        if k > 0 and base.otherwise is ZERO:
            return where(base.condition, integer_power(base.then, k), ZERO)
        if k < 0:
            return _into_branches(base, lambda u: integer_power(u, k))
    return Pow.make(k, (base,))


def call(name: str, *arguments: Expr) -> Expr:
    """Returns a function of the language applied. A function that is singular somewhere is moved into the branches of a `where`."""
    if all(isinstance(a, Const) for a in arguments):
        try:
            value = FUNCTIONS[name](*[a.data for a in arguments])
            if math.isfinite(value):
                return const(value)
        except (ValueError, OverflowError, ZeroDivisionError):
            pass
    if name == "exp" and isinstance(arguments[0], Call) and arguments[0].name == "log":
        return arguments[0].children[0]
    if name in _SINGULAR and isinstance(arguments[0], Where):
        others = arguments[1:]
        return _into_branches(arguments[0], lambda u: call(name, u, *others))
    if any(a.has_delta for a in arguments):
        raise DeltaError(
            f"a Dirac delta inside {name} has no meaning",
            Call.make(name, arguments),
            "a delta may only be added and multiplied",
        )
    return Call.make(name, arguments)


def uncounted_floor(u: Expr) -> Expr:
    """floor(u) whose steps are not written out; of a number a number."""
    e = call("floor", u)
    return UncountedFloor.make("floor", (u,)) if isinstance(e, Call) else e


def _into_branches(outer: Where, f: Callable[[Expr], Expr]) -> Expr:
    """Returns f of a `where`, applied branch by branch. Iterative; each shared branch is visited once."""
    done: dict[Expr, Expr] = {}
    stack: list[Expr] = [outer]
    while stack:
        e = stack[-1]
        if not isinstance(e, Where):
            done.setdefault(e, f(e))
        elif missing := [u for u in (e.then, e.otherwise) if u not in done]:
            stack.extend(missing)
            continue
        else:
            done[e] = where(e.condition, done[e.then], done[e.otherwise])
        stack.pop()
    return done[outer]


def where(condition: Cond, then: Expr, otherwise: Expr) -> Expr:
    """Returns `then` where the condition holds, else `otherwise`."""
    if condition is TRUE or then is otherwise:
        return then
    if condition is FALSE:
        return otherwise
    if isinstance(condition, Not):
        condition, then, otherwise = condition.operand, otherwise, then
    if isinstance(then, Where) and then.condition is condition:
        then = then.then
    if isinstance(otherwise, Where) and otherwise.condition is condition:
        otherwise = otherwise.otherwise
    if otherwise is ZERO and isinstance(then, Where) and then.otherwise is ZERO:
        condition, then = conjunction(condition, then.condition), then.then
    return then if then is otherwise else Where.make(None, (condition, then, otherwise))


def bracket(condition: Cond) -> Expr:
    """Returns 1 where the condition holds, else 0 (Iverson)."""
    return where(condition, ONE, ZERO)


def absolute(u: Expr) -> Expr:
    """Returns |u| = where(u > 0, u, -u)."""
    return where(positive(u), u, mul(MINUS_ONE, u))


def positive(g: Expr, strict: bool = True, resolution: Cond | None = None, rivals: tuple[str, str] | None = None) -> Cond:
    """Returns the atom g > 0, or g >= 0.

    A constant `g` decides the atom, except a 0 with a `resolution`: two surfaces coincide there, and only the order of a tie tells them
    apart.
    """
    if isinstance(g, Const) and (resolution is None or g.data != 0):
        return TRUE if g.data > 0 or (not strict and g.data == 0) else FALSE
    if g.has_delta:
        raise DeltaError("a Dirac delta inside a condition has no meaning", g)
    if resolution is None:
        return Compare.make((strict, None), (g,))
    return Compare.make((strict, rivals), (g, resolution))


def less(a: object, b: object, strict: bool) -> Cond:
    """Returns a < b, or a <= b."""
    if isinstance(a, Tuple) or isinstance(b, Tuple):
        hint = "compare their entries: (e[0] < a) & (e[1] < b)"
        raise ConditionError("tuples are not compared", a if isinstance(a, Tuple) else b, hint)
    if isinstance(a, Cond) or isinstance(b, Cond):
        raise ConditionError(
            "a condition cannot be compared",
            a if isinstance(a, Cond) else b,
            "write (a < x) & (x < b) for a < x < b",
        )
    g = as_number(b) - as_number(a)
    return positive(g, strict)


def negation(c: Cond) -> Cond:
    """Returns ~c."""
    if isinstance(c, Truth):
        return FALSE if c.data else TRUE
    return c.operand if isinstance(c, Not) else Not.make(None, (c,))


def conjunction(*conditions: Cond) -> Cond:
    """Returns a & b & …"""
    return _junction(And, conditions, FALSE, TRUE)


def disjunction(*conditions: Cond) -> Cond:
    """Returns a | b | …"""
    return _junction(Or, conditions, TRUE, FALSE)


def _junction(cls: type[And] | type[Or], conditions: Iterable[Cond], absorbing: Truth, neutral: Truth) -> Cond:
    kept: dict[Cond, None] = {}
    for c in conditions:
        if c is absorbing:
            return absorbing
        if isinstance(c, cls) and len(c.children) <= _FLATTEN:
            kept.update(dict.fromkeys(c.children))
        elif c is not neutral:
            kept[c] = None
    for c in kept:
        if isinstance(c, Not) and c.operand in kept:
            return absorbing
    if not kept:
        return neutral
    return next(iter(kept)) if len(kept) == 1 else cls.make(None, tuple(kept))


def tuple_of(*entries: Expr) -> Tuple:
    """Returns several expressions to be evaluated together."""
    return Tuple.make(None, entries)
