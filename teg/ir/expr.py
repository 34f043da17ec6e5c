"""The expression language: numbers, parameters, variables, arithmetic, functions, conditions, `where`, tuples.

    e ::= c | p | x | e + … + e | e · … · e | e^k | f(e, …) | where(b, e, e) | (e, …, e)          (binders stand in integral.py)
    b ::= g > 0 | g >= 0 | ~b | b & … & b | b | … | b | true | false

A comparison a < b is kept as the atom g = b - a > 0. Nodes are built by the functions of `simplify.py` (`add`, `mul`, `where`, …); the
operators of `Expr` call these by way of `operands.py`.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, cast

from teg.errors import ConditionError, OperandError
from teg.ir.foreign_names import ours
from teg.ir.node import Node, new_bit, postorder_to
from teg.numerics.error_function import inverse_erf, inverse_erfc

if TYPE_CHECKING:
    from decimal import Decimal
    from fractions import Fraction

    import numpy as np

    from teg.ir.index import Index


Operand: TypeAlias = "Expr | Index | float | np.floating[Any] | np.integer[Any] | Fraction | Decimal"
"""The types of numbers: expressions, indices, and real numbers of Python and NumPy."""


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
        hint = f"write {ours(ufunc.__name__) or 'what it does with the operators and the functions of teg'}"
        raise OperandError(f"numpy.{ufunc.__name__} does not know expressions", self, hint)

    def __add__(self, other: Operand) -> Expr:
        return binary(self, other, add)

    def __radd__(self, other: Operand) -> Expr:
        return binary(other, self, add)

    def __sub__(self, other: Operand) -> Expr:
        return binary(self, other, sub)

    def __rsub__(self, other: Operand) -> Expr:
        return binary(other, self, sub)

    def __mul__(self, other: Operand) -> Expr:
        return binary(self, other, mul)

    def __rmul__(self, other: Operand) -> Expr:
        return binary(other, self, mul)

    def __truediv__(self, other: Operand) -> Expr:
        return binary(self, other, div)

    def __rtruediv__(self, other: Operand) -> Expr:
        return binary(other, self, div)

    def __mod__(self, other: Operand) -> Expr:
        return entrywise(lambda a, b: call("mod", a, b), self, other)

    def __rmod__(self, other: Operand) -> Expr:
        return entrywise(lambda a, b: call("mod", a, b), other, self)

    def __floordiv__(self, other: Operand) -> Expr:
        return entrywise(lambda u: call("floor", u), self / other)

    def __rfloordiv__(self, other: Operand) -> Expr:
        return entrywise(lambda u: call("floor", u), other / self)

    def __pow__(self, other: Operand) -> Expr:
        return binary(self, other, power)

    def __rpow__(self, other: Operand) -> Expr:
        return binary(other, self, power)

    def __neg__(self) -> Expr:
        return binary(MINUS_ONE, self, mul)

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

    def __format__(self, spec: str) -> str:
        if spec.endswith(tuple("eEfFgGn%")):
            raise OperandError("an expression is not a number yet", self, "a number is given by teg.evaluate(e, {parameter: value})")
        return format(str(self), spec)

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

        def __xor__(self, _: object) -> NoReturn:
            raise OperandError("^ is no operator of numbers", self, "write u**2 for a power")

        __rxor__ = __xor__

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

    def _own_kinds(self) -> int:
        return self.own_kinds | _NAME_BITS.get(self.data, 0)

    @property
    def name(self) -> str:
        return self.data  # type: ignore[no-any-return]


class UncountedFloor(Call):
    """floor(u) with more steps than are written out one by one."""

    __slots__ = ()


class HalfAngle(Call):
    """atan2(y, x) where x is not negative: there it has no cut."""

    __slots__ = ()


def has_cut(e: Node) -> bool:
    """Returns whether an expression is an angle whose cut, where the first argument is 0 and the second negative, may be met."""
    if not isinstance(e, Call) or e.name != "atan2" or isinstance(e, HalfAngle):
        return False
    v, u = e.children
    return bool(v.free) and not (isinstance(u, Const) and u.data > 0.0)


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

        def __xor__(self, _: object) -> NoReturn:
            raise ConditionError("^ does not join conditions", self, f"write {ours('logical_xor')}")

        __rxor__ = __xor__

    def __array_ufunc__(self, ufunc: Any, *_: object, **__: object) -> NoReturn:
        """Raises ConditionError: no function of NumPy accepts conditions."""
        if ufunc.__name__ in _NUMPY_OPERATORS:
            self._is_no_number()
        hint = f"write {ours(ufunc.__name__) or '& | ~ between conditions, or teg.bracket(condition) for 1 or 0'}"
        raise ConditionError(f"numpy.{ufunc.__name__} does not know conditions", self, hint)


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
    "chosen": float, "exact": float,
}  # fmt: skip
"""The functions of the language, and eight that only the compiler uses.

`erfinv` and `erfcinv` are the inverses of erf and erfc, for the roots of conditions.
`magnitude` is |u| without a surface at u = 0, for weights that cannot vanish. `root` is √u where u >= 0, and a number, not NaN, where
rounding takes u below 0. `min` and `max` serve interval bounds. `exact` is u without its rounding errors, so that these decide no tie.
`chosen` is the same where any number near u does as well, like the place at which a chart starts: its derivative is 0.
"""


_NAME_BITS: dict[Any, int] = {name: new_bit() for name in FUNCTIONS}


def called(*names: str) -> int:
    """Returns the kinds of nodes that apply one of these functions."""
    return sum(_NAME_BITS[name] for name in names)


def calls_of(kinds: int, *roots: Node) -> list[Call]:
    """Returns the nodes that apply functions of some kinds, children before parents."""
    return [n for n in postorder_to(roots, kinds) if isinstance(n, Call) and _NAME_BITS.get(n.data, 0) & kinds]


def const(value: float) -> Const:
    """Returns a number as an expression."""
    shared = _UNITS.get(value)
    return Const.make(float(value) + 0.0, ()) if shared is None else shared


def is_infinite(e: Expr) -> bool:
    """Returns whether an expression is the number ∞ or -∞, as a bound may be."""
    return isinstance(e, Const) and math.isinf(e.data)


ZERO, ONE, MINUS_ONE = (Const.make(value, ()) for value in (0.0, 1.0, -1.0))
_UNITS = {0.0: ZERO, 1.0: ONE, -1.0: MINUS_ONE}  # -0.0 is 0.0 as well
TRUE, FALSE = Truth.make(True, ()), Truth.make(False, ())


# The operators above call functions that are made of the nodes above.
from teg.ir.operands import as_condition, as_number, binary, entrywise, less  # noqa: E402
from teg.ir.simplify import absolute, add, call, conjunction, disjunction, div, mul, negation, power, sub  # noqa: E402
