"""Integer expressions: indices of arrays, and bounds of sums.

    i ::= n | k | p | length(A, axis) | F[i, …] | i + i | i - i | i · i | i // i | i % i | min(i, i) | max(i, i)

k is the index of a sum, p a parameter whose value is an integer, F an array of integers. `//` and `%` round down, as in Python. An
integer expression converts to a number where a number is expected (`IndexValue`); it has no derivative.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from numbers import Integral as IntegralNumber
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, cast

from teg.errors import ArrayIndexError, ConditionError, OperandError
from teg.ir.expr import Cond, Expr, Operand, Param
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number, less

if TYPE_CHECKING:
    import numpy as np

OPERATIONS: dict[str, Callable[[int, int], int]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "floordiv": operator.floordiv, "mod": operator.mod,
    "min": min, "max": max,
}  # fmt: skip
Place: TypeAlias = "Index | int | Param | np.integer[Any]"
"""The types of integers: indices, parameters that hold an integer, and numbers."""
_SIGNS = {"add": " + ", "sub": " - ", "mul": "·", "floordiv": " // ", "mod": " % "}
LARGEST = 2**62
"""The integers of a program are smaller than this. They are 64 bits wide at run time."""


APART = "\0"
"""Stands between the name of an index and a number that makes the name unique. No name given by a user contains it."""


class Index(Node):
    """An integer expression: an index of a sum, a length, an entry of an integer array, and `+ - * // %` of these.

        k = teg.index("k")
        str((k + 1) % 3)                                    # (k + 1) % 3

    Where a number is expected it becomes one, whose derivative is 0.
    """

    __slots__ = ()

    def _as_expression(self) -> Expr:
        return cast(Expr, IndexValue.make(self, ()))

    def _binary(self, other: object, name: str, mirrored: bool = False) -> Any:
        if isinstance(other, Index) or (isinstance(other, IntegralNumber) and not isinstance(other, bool)):
            return index_call(name, *((as_index(other), self) if mirrored else (self, as_index(other))))
        a, b = as_number(other), as_number(self)
        left, right = (a, b) if mirrored else (b, a)
        return _ON_NUMBERS[name](left, right)

    def __add__(self, other: Operand) -> Any:
        return self._binary(other, "add")

    def __radd__(self, other: Operand) -> Any:
        return self._binary(other, "add", True)

    def __sub__(self, other: Operand) -> Any:
        return self._binary(other, "sub")

    def __rsub__(self, other: Operand) -> Any:
        return self._binary(other, "sub", True)

    def __mul__(self, other: Operand) -> Any:
        return self._binary(other, "mul")

    def __rmul__(self, other: Operand) -> Any:
        return self._binary(other, "mul", True)

    def __floordiv__(self, other: Operand) -> Any:
        return self._binary(other, "floordiv")

    def __rfloordiv__(self, other: Operand) -> Any:
        return self._binary(other, "floordiv", True)

    def __mod__(self, other: Operand) -> Any:
        return self._binary(other, "mod")

    def __rmod__(self, other: Operand) -> Any:
        return self._binary(other, "mod", True)

    def __neg__(self) -> Any:
        return index_call("sub", index_const(0), self)

    def __pos__(self) -> Index:
        return self

    def __truediv__(self, other: Operand) -> Expr:
        return as_number(self) / other

    def __rtruediv__(self, other: Operand) -> Expr:
        return other / as_number(self)

    def __pow__(self, other: Operand) -> Expr:
        return as_number(self) ** other

    def __rpow__(self, other: Operand) -> Expr:
        return other ** as_number(self)

    def __lt__(self, other: Operand) -> Cond:
        return less(self, other, strict=True)

    def __le__(self, other: Operand) -> Cond:
        return less(self, other, strict=False)

    def __gt__(self, other: Operand) -> Cond:
        return less(other, self, strict=True)

    def __ge__(self, other: Operand) -> Cond:
        return less(other, self, strict=False)

    def __bool__(self) -> NoReturn:
        raise ConditionError("an index has no truth value while the program is being written", self, "teg.where(k < n, a, b) chooses")

    def __index__(self) -> NoReturn:
        raise ArrayIndexError(
            "an index of the program is not a number yet, so Python cannot index by it",
            self,
            'arrays of the program are made by teg.array("V", 2)',
        )

    def __iter__(self) -> NoReturn:
        raise OperandError("an index cannot be iterated over", self, "teg.sum(body, (k, 0, n)) runs it")


_ON_NUMBERS: dict[str, Callable[[Any, Any], Any]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "floordiv": operator.floordiv, "mod": operator.mod,
}  # fmt: skip


class IndexConst(Index):
    """An integer."""

    __slots__ = ()


class IndexVar(Index):
    """The index of a sum."""

    __slots__ = ()

    @property
    def name(self) -> str:
        return cast(str, self.data)


class IndexParam(Index):
    """A parameter whose value is an integer; data is its Param."""

    __slots__ = ()

    @property
    def param(self) -> Param:
        return cast(Param, self.data)


class IndexCall(Index):
    """Two integers combined. Data is the operation's name."""

    __slots__ = ()
    children: tuple[Index, ...]


class ArrayName(Node):
    """An array that is given when the program is called. Data are (name, dimensions). It is not an expression; its entries are."""

    __slots__ = ()

    @property
    def name(self) -> str:
        return cast(str, self.data[0])

    @property
    def dimensions(self) -> int:
        return cast(int, self.data[1])

    def subscripts(self, places: object) -> tuple[Index, ...]:
        """Returns the integers in the square brackets, one for each dimension."""
        entries = places if isinstance(places, tuple) else (places,)
        if len(entries) != self.dimensions:
            shown = ", ".join(map(str, entries))
            hint = f"write {self.name}[{', '.join('ijklmn'[: self.dimensions])}]"
            raise ArrayIndexError(
                f"{self.name} has {self.dimensions} dimensions and is indexed by {len(entries)}: {self.name}[{shown:.80}]", self, hint
            )
        subscripts = tuple(as_index(place, self) for place in entries)
        for place in subscripts:
            if isinstance(place, IndexConst) and place.data < 0:
                hint = f"count from the front, or write teg.length({self.name}, axis) - 1"
                raise ArrayIndexError(f"the index {place.data} of {self.name} is negative", self, hint)
        return subscripts

    def _no_arithmetic(self, *_: object, **__: object) -> NoReturn:
        zeros = ", ".join("0" * self.dimensions)
        raise OperandError(
            f"{self.name} is an array, and arithmetic is on its entries", self, f"write {self.name}[{zeros}], or a teg.sum over indices"
        )

    if not TYPE_CHECKING:  # type checkers report these themselves
        __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _no_arithmetic
        __mod__ = __rmod__ = __floordiv__ = __rfloordiv__ = __pow__ = __rpow__ = __lt__ = __le__ = __gt__ = __ge__ = _no_arithmetic
        __neg__ = __float__ = __bool__ = __abs__ = __iter__ = __len__ = __array_ufunc__ = _no_arithmetic
    _as_expression = _no_arithmetic


class IndexArray(ArrayName):
    """An array of integers, for gathers; not differentiable."""

    __slots__ = ()

    def __getitem__(self, places: Place | tuple[Place, ...]) -> Index:
        return IndexGather.make(self, self.subscripts(places))


class IndexGather(Index):
    """An entry of an array of integers; data is the array, the children are the subscripts."""

    __slots__ = ()
    children: tuple[Index, ...]

    @property
    def array(self) -> IndexArray:
        return cast(IndexArray, self.data)


class Length(Index):
    """The length of an array along an axis; data is (array, axis)."""

    __slots__ = ()

    @property
    def array(self) -> ArrayName:
        return cast(ArrayName, self.data[0])

    @property
    def axis(self) -> int:
        return cast(int, self.data[1])


class IndexValue(Expr):
    """An integer as a number; data is the integer expression."""

    __slots__ = ()

    @property
    def index(self) -> Index:
        return cast(Index, self.data)


def index_const(value: int) -> IndexConst:
    """Returns an integer as an expression."""
    if abs(value) >= LARGEST:
        raise ArrayIndexError(f"{value} is too large for an index")
    return IndexConst.make(int(value), ())


def index_call(name: str, a: Index, b: Index) -> Index:
    """Returns two integers combined; a number if both are numbers."""
    if isinstance(b, IndexConst) and b.data == 0 and name in ("floordiv", "mod"):
        raise ArrayIndexError("an index is divided by 0", IndexCall.make(name, (a, b)))
    if isinstance(a, IndexConst) and isinstance(b, IndexConst):
        return index_const(OPERATIONS[name](a.data, b.data))
    if isinstance(b, IndexConst) and ((b.data == 0 and name in ("add", "sub")) or (b.data == 1 and name in ("mul", "floordiv"))):
        return a
    if isinstance(a, IndexConst) and ((a.data == 0 and name == "add") or (a.data == 1 and name == "mul")):
        return b
    return IndexCall.make(name, (a, b))


def as_index(value: object, where: object = None) -> Index:
    """Returns the integer expression for an int, an index, or a parameter that holds an integer. Raises
    ArrayIndexError for other values."""
    if isinstance(value, Index):
        return value
    if isinstance(value, IndexValue):
        return value.index
    if isinstance(value, IntegralNumber) and not isinstance(value, bool):
        return index_const(int(value))
    if isinstance(value, Param):
        return IndexParam.make(value, ())
    if isinstance(value, slice):
        raise ArrayIndexError("an array of the program has no slices", where, "sum over an index: teg.sum(V[k], (k, 0, teg.length(V, 0)))")
    if isinstance(value, ArrayName):
        raise ArrayIndexError(f"{value.name} is an array, an index is one integer", where, f"write {value.name}[k]")
    if isinstance(value, Expr):
        hint = "integers, teg.index, teg.indices, teg.length and + - * // % of these; a condition chooses by teg.where(c, V[0], V[1])"
        raise ArrayIndexError("this index is a real number of the program, not an integer", value, hint)
    hint = "integers, teg.index, entries of teg.indices, teg.length and + - * // % of these"
    raise ArrayIndexError(f"{value!r:.80} is not an integer, and cannot be an index", where, hint)


def index_leaves(roots: Iterable[Node]) -> list[Index]:
    """Returns every node of integer expressions, children first."""
    return [n for n in postorder(roots) if isinstance(n, Index)]


def free_indices(index: Index) -> frozenset[IndexVar]:
    """Returns the indices of sums that occur in an integer expression."""
    return frozenset(n for n in postorder([index]) if isinstance(n, IndexVar))


def substitute_index(root: Index, replace: Callable[[Index], Index | None]) -> Index:
    """Returns the expression rebuilt bottom up: `replace` returns another node for a node, or None to keep it."""
    new: dict[Node, Index] = {}
    for node in index_leaves([root]):
        rebuilt: Index = node
        if isinstance(node, IndexCall):
            rebuilt = index_call(node.data, new[node.children[0]], new[node.children[1]])
        elif isinstance(node, IndexGather):
            rebuilt = IndexGather.make(node.array, tuple(new[c] for c in node.children))
        other = replace(rebuilt)
        new[node] = rebuilt if other is None else other
    return new[root]


def show_index(root: Index) -> str:
    """Returns an integer expression as one line."""
    text: dict[Node, str] = {}
    for node in index_leaves([root]):
        parts = [text[c] for c in node.children]
        match node:
            case IndexConst():
                text[node] = str(node.data)
            case IndexVar():
                text[node] = node.name
            case IndexParam():
                text[node] = node.param.name
            case Length():
                text[node] = f"length({node.array.name}, {node.axis})"
            case IndexGather():
                text[node] = f"{node.array.name}[{', '.join(parts)}]"
            case IndexCall() if node.data in _SIGNS:
                text[node] = f"({parts[0]}{_SIGNS[node.data]}{parts[1]})"
            case IndexCall():
                text[node] = f"{node.data}({', '.join(parts)})"
            case _:
                raise AssertionError(f"unknown index {type(node).__name__}")
    shown = text[root]
    return shown[1:-1] if isinstance(root, IndexCall) and root.data in _SIGNS else shown


def _name_of(a: ArrayName) -> str:
    return a.name


def _install() -> None:
    """Installs the text of integers and arrays."""
    Index.__str__ = Index.__repr__ = show_index  # type: ignore[assignment,method-assign]
    ArrayName.__str__ = ArrayName.__repr__ = _name_of  # type: ignore[assignment,method-assign]


_install()
