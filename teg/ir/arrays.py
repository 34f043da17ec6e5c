"""Arrays of parameters and sums over indices.

    e ::= … | V[i, …] | i | Σ[k: i..i] e          entries of an array, integers as numbers, sums over a half-open range
    d ::= … | 1[V; i, …]                          in gradients: the array that is 1 at one place and 0 elsewhere

An entry is a leaf like a parameter. The derivative by an array is an array: a sum of numbers times `Unit`s, each added at the place that
its indices name (a scatter). Units stand in linear positions only: in sums, products with numbers and branches.
"""

from __future__ import annotations

from typing import TypeAlias, cast, overload

from teg.errors import ArrayIndexError, OperandError, ParameterError, ScopeError
from teg.ir import simplify
from teg.ir.creation import created
from teg.ir.expr import ZERO, Expr, Operand, Param, Tuple
from teg.ir.index import (
    ArrayName,
    Index,
    IndexArray,
    IndexConst,
    IndexParam,
    IndexValue,
    IndexVar,
    Length,
    Place,
    as_index,
    index_leaves,
    show_index,
)
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number, refuse_list

MAX_DIMENSIONS = 8


class Array(ArrayName):
    """An array of parameters, made by `teg.array`. Derivatives are taken by all of its entries.

        V, k = teg.array("V", 2), teg.index("k")
        str(V[k + 1, 0] ** 2)                               # V[k + 1, 0]²

    `name` is its name, `dimensions` how many indices an entry has. Raises ArrayIndexError for another number of indices, or one that is
    no integer.
    """

    __slots__ = ()

    def __getitem__(self, places: Place | tuple[Place, ...]) -> Gather:
        return Gather.make((self, self.subscripts(places)), ())


class Entry(Expr):
    """A place in an array of parameters; data is (array, subscripts)."""

    __slots__ = ()

    @property
    def array(self) -> Array:
        return cast(Array, self.data[0])

    @property
    def subscripts(self) -> tuple[Index, ...]:
        return cast("tuple[Index, ...]", self.data[1])


class Gather(Entry):
    """The number at a place of an array."""

    __slots__ = ()


class StillGather(Gather):
    """The same without a derivative (`teg.ir.still`)."""

    __slots__ = ()


class Unit(Entry):
    """The array that is 1 at a place and 0 elsewhere."""

    __slots__ = ()


class Ranged(Node):
    """A node that binds an index, which runs from lo up to hi - 1; data begin with (index, lo, hi)."""

    __slots__ = ()

    @property
    def index(self) -> IndexVar:
        return cast(IndexVar, self.data[0])

    @property
    def lo(self) -> Index:
        return cast(Index, self.data[1])

    @property
    def hi(self) -> Index:
        return cast(Index, self.data[2])

    def over(self, children: tuple[Node, ...], k: IndexVar, lo: Index, hi: Index) -> Node:
        """Returns the node with other children, over another index or range."""
        return type(self).make((k, lo, hi, *self.data[3:]), children)


class Sum(Ranged, Expr):
    """Σ body over an index."""

    __slots__ = ()

    def over(self, children: tuple[Node, ...], k: IndexVar, lo: Index, hi: Index) -> Node:
        return sum_over(cast(Expr, children[0]), k, lo, hi)

    @property
    def body(self) -> Expr:
        return cast(Expr, self.children[0])


class Placed(Expr):
    """A number that belongs to a place in a table (the child); data are (row, column)."""

    __slots__ = ()

    @property
    def row(self) -> Index:
        return cast(Index, self.data[0])

    @property
    def column(self) -> int:
        return cast(int, self.data[1])

    @property
    def table(self) -> Expr:
        return cast(Expr, self.children[0])


class Slope(Placed):
    """The derivative of a `Partition` (the child) by a number of one candidate, or by a number of what stands where there is none.

    The row is the index of the candidate, or the end of the range; the column is the place of the number among the numbers of a candidate.
    """

    __slots__ = ()


LEAVES = (Gather, Unit, IndexValue, Placed)
_OF_ARRAYS = Gather.bit | Unit.bit | IndexValue.bit | Placed.bit | Ranged.bit

# -- what users call ---------------------------------------------------------------------------------------------------


def _named(name: object, what: str) -> str:
    if not isinstance(name, str) or not name:
        raise OperandError(f"an {what} is named by a string that is not empty, not by {name!r:.80}")
    return name


def identifier(name: str, several: str = "") -> str:
    """Returns the name of an argument of programs. Raises ParameterError if Python cannot take it as a keyword."""
    if not name.isidentifier():
        hint = "letters, digits and _, a letter first: f(name=value)"
        if several and len(name.split()) > 1:
            hint = f"several at once: teg.{several}({name!r:.80})"
        raise ParameterError(f"{name!r:.80} is not a name for an argument", None, hint)
    return name


def _dimensions(dimensions: object, name: str) -> int:
    if isinstance(dimensions, bool) or not isinstance(dimensions, int) or not 1 <= dimensions <= MAX_DIMENSIONS:
        hint = "a single number is a teg.param, a single integer too: teg.param is one where an index is expected"
        raise ArrayIndexError(f"{name!r:.80} cannot have {dimensions!r:.80} dimensions; 1 to {MAX_DIMENSIONS}", None, hint)
    return dimensions


def array(name: str, dimensions: int = 1) -> Array:
    """Returns an array of parameters with so many dimensions (1 to 8). Its entries `V[i, 0]` are expressions.

        V, k = teg.array("V", 2), teg.index("k")
        f = teg.compile(teg.sum(V[k, 0] * V[k, 1], (k, 0, teg.length(V, 0))), [V])
        value, gradient = f.value_and_grad(V=[[1.0, 2.0], [3.0, 4.0]])
        value                                               # 14.0
        gradient["V"].tolist()                              # [[2.0, 1.0], [4.0, 3.0]]

    The shape is known when the program is called. Raises ParameterError for a name that is no identifier, ArrayIndexError for another
    number of dimensions, or if the array is indexed by anything but integers, or by too few.
    """
    return created(Array.make((identifier(_named(name, "array")), _dimensions(dimensions, name)), ()))


def indices(name: str, dimensions: int = 1) -> IndexArray:
    """Returns an array of integers with so many dimensions, for gathers. It is not differentiable.

        V, F, k = teg.array("V"), teg.indices("F", 2), teg.index("k")
        f = teg.compile(teg.sum(V[F[k, 1]] - V[F[k, 0]], (k, 0, teg.length(F, 0))))
        f(V=[1.0, 5.0, 7.0], F=[[0, 1], [1, 2]])            # 6.0

    Raises as `teg.array` does.
    """
    return created(IndexArray.make((identifier(_named(name, "array of indices")), _dimensions(dimensions, name)), ()))


def index(name: str) -> IndexVar:
    """Returns the index of a sum. The same name is the same index. Raises OperandError for a name that is no string.

    k = teg.index("k")
    teg.evaluate(teg.sum(k * k, (k, 0, 4)))             # 14.0
    """
    return IndexVar.make(_named(name, "index"), ())


def length(of: ArrayName, axis: int = 0) -> Index:
    """Returns the length of an array along an axis, an integer that is known when the program is called.

        V, k = teg.array("V", 2), teg.index("k")
        f = teg.compile(teg.sum(V[k, 0], (k, 0, teg.length(V, 0))) / teg.length(V, 0))
        f(V=[[1.0, 7.0], [3.0, 8.0]])                       # 2.0

    Raises ArrayIndexError for an argument that is no array, and for an axis that the array does not have.
    """
    if not isinstance(of, ArrayName):
        raise ArrayIndexError("teg.length takes an array", of, 'teg.length(V, 0) of V = teg.array("V", 2)')
    if isinstance(axis, bool) or not isinstance(axis, int) or not 0 <= axis < of.dimensions:
        raise ArrayIndexError(f"{of.name} has axes 0 to {of.dimensions - 1}, not {axis!r:.80}", of)
    return Length.make((of, axis), ())


Range: TypeAlias = tuple[IndexVar, Place, Place]
"""The type of a triple (index, first, end)."""


@overload
def sum_(body: Tuple, *ranges: Range) -> Tuple: ...
@overload
def sum_(body: Operand, *ranges: Range) -> Expr: ...
def sum_(body: Operand, *ranges: Range) -> Expr:
    """Returns the sum of `body` over the triples (index, first, end), the first triple innermost; `end` is excluded, as in ``range``.

    Bounds are integers, parameters that hold integers, teg.length, and integer expressions of the indices of later triples. A tuple is
    summed entry by entry. Raises ScopeError for a malformed triple, ArrayIndexError for a bound that is not an integer.

        j, k = teg.index("j"), teg.index("k")
        teg.evaluate(teg.sum(j, (j, 0, k), (k, 0, 4)))      # 4.0: 0 + 0 + (0 + 1) + (0 + 1 + 2)
    """
    refuse_list(body, "sum", "Python's sum(…) adds a list")
    e = body if isinstance(body, Tuple) else as_number(body)
    if not ranges:
        raise ScopeError("a sum needs an index and its range", e, "write teg.sum(e, (k, 0, n))")
    for triple in ranges:
        if not isinstance(triple, tuple | list) or len(triple) != 3:
            raise ScopeError(f"{triple!r:.80} is not (index, first, end)", e, "write teg.sum(e, (k, 0, n), (j, 0, m))")
        k, lo, hi = triple
        if not isinstance(k, IndexVar):
            raise ScopeError(f"a sum runs over an index, not over {type(k).__name__} {k!s:.80}", e, 'make one with k = teg.index("k")')
        first, end = as_index(lo, e), as_index(hi, e)
        if isinstance(first, IndexConst) and isinstance(end, IndexConst) and end.data < first.data:
            raise ArrayIndexError(f"the range of {k.name} has a negative length: from {first.data} to {end.data}", e)
        if k in index_leaves([first, end]):
            raise ScopeError(f"the range of {k.name} depends on {k.name} itself", e, "bounds may depend on the indices of sums further out")
        e = sum_over(e, k, first, end, as_written=True)
    return e


def sum_over(body: Expr, k: IndexVar, lo: Index, hi: Index, as_written: bool = False) -> Expr:
    """Returns Σ body for k in [lo, hi)."""
    if isinstance(body, Tuple):
        return simplify.tuple_of(*(sum_over(entry, k, lo, hi, as_written) for entry in body.children))
    if (body is ZERO and not as_written) or (lo is hi and not as_written):
        return ZERO
    return Sum.make((k, lo, hi), (body,))


# -- walking -----------------------------------------------------------------------------------------------------------


def has_arrays(root: Node) -> bool:
    """Returns whether a program has arrays, indices or sums."""
    return root.kinds & _OF_ARRAYS != 0


def integers_of(node: Node) -> tuple[Index, ...]:
    """Returns the integer expressions of one node."""
    match node:
        case Gather() | Unit():
            return node.subscripts
        case IndexValue():
            return (node.index,)
        case Ranged():
            return (node.lo, node.hi)
        case Placed():
            return (node.row,)
        case _:
            return ()


def arrays_of(root: Node) -> list[ArrayName]:
    """Returns the arrays of a program, in order of first appearance."""
    arrays: dict[ArrayName, None] = {}
    for node in postorder([root]):
        for leaf in index_leaves(integers_of(node)):
            if isinstance(leaf, Length):
                arrays[leaf.array] = None
            elif leaf.data.__class__ is IndexArray:
                arrays[leaf.data] = None
        if isinstance(node, Gather | Unit):
            arrays[node.array] = None
    return list(arrays)


def integer_parameters(root: Node) -> list[Param]:
    """Returns the parameters of a program that are used as integers, in order of first appearance."""
    parameters: dict[Param, None] = {}
    for node in postorder([root]):
        parameters.update((leaf.param, None) for leaf in index_leaves(integers_of(node)) if isinstance(leaf, IndexParam))
    return list(parameters)


def open_indices(root: Node) -> dict[Node, frozenset[IndexVar]]:
    """Returns, for every node below, the indices of sums that occur free in it."""
    opened: dict[Node, frozenset[IndexVar]] = {}
    for node in postorder([root]):
        own = frozenset(leaf for leaf in index_leaves(integers_of(node)) if isinstance(leaf, IndexVar))
        inner: frozenset[IndexVar] = frozenset()
        for c in node.children:
            inner = inner if opened[c] <= inner else inner | opened[c]
        if isinstance(node, Ranged):
            inner = inner - {node.index}
        opened[node] = inner | own if own else inner
    return opened


def show_leaf(node: Expr) -> str:
    """Returns an entry of an array, a unit, or an integer, as text."""
    if isinstance(node, Placed):
        return f"{type(node).__name__.lower()}[{show_index(node.row)}, {node.column}]"
    if isinstance(node, Gather | Unit):
        places = ", ".join(map(show_index, node.subscripts))
        if isinstance(node, StillGather):
            return f"stop({node.array.name}[{places}])"
        return f"{node.array.name}[{places}]" if isinstance(node, Gather) else f"1[{node.array.name}; {places}]"
    return f"({show_index(cast(IndexValue, node).index)})"
