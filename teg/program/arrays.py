"""The program of an expression with arrays and sums: loops around flat programs.

    step ::= name = op(i, …)                        Integers: an integer of indices, lengths, integer parameters, entries of index arrays
           | name = A[i, …]                         Load: an entry of an array of parameters
           | name = i                               Number: an integer as a float64
           | names = kernel(names…)                 Run: a flat program (`teg.program`) on numbers
           | names = Σ i in [lo, hi): steps         Loop: each result is the sum of its value over the iterations
           | names = winner i in [lo, hi): steps    Least: each result is the index of the least value
           | names = Π i in [lo, hi): steps         Factors: each result is the product of its values
           | names = ∫∫ nearest i in [lo, hi): steps    Cells: each result is the integral of the polynomial of the nearest candidate
           | names = gaps i in [lo, hi): steps      Gaps: each result is the sum of its value over the gaps that the iterations leave
           | table = rows i in [lo, hi): steps      Rows: a table with the values of each iteration
           | table = Σ weight·table                 Combined: the derivatives of a weighted sum of results of Cells
           | table = zeros                          Blank: a table that is added to
           | table[i, column] += name               AddTo
           | name = table[i, column]                Take: from a table of Rows, Blank or Combined, or a derivative that a Cells has left
           | output[i, …] += name                   Scatter: into an output that is an array

Names are given once in the whole program; a step uses those of its own block before it, of the enclosing blocks, and the parameters.
Integers are called 'i…' (64 bits), numbers 'v…'; scalar parameter k is 'p{k}'. An `int` or `float` argument is a literal.

Integer operations: add sub mul floordiv mod min max (as Python's), gather(A, i, …), length(A, axis), param(k): parameter k, whose value is
an integer. Every subscript is inside its array and every length of a range is at least 0: this is checked before a program is run
(`teg.backends.plan`), not by it.

Ties. A Run resolves its ties by itself: the flat program is run in both orders where it meets one, and the mean goes on. So a tie of one
iteration costs that iteration twice, not the whole sum.

Sums are added in the order of the iterations within a chunk, and chunks in their order. How many chunks there are depends on the shapes
alone, so results have the same bits for any number of threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

from teg.numerics.cells import Layout
from teg.program.fields import INTEGER, NUMBER, Block, Operand, Result, Variable, inner_blocks
from teg.program.statements import Program
from teg.program.walk import size

CHUNKS = 64
"""Chunks of an outermost loop, at most."""
LEAST = 20_000
"""Operations that a chunk is worth."""
COPIES = 2**25
"""Numbers in the copies of outputs that chunks scatter into, at most."""

Arg = str | int | float
SQUARE = Layout(1, 1, 0)
"""Candidates with one guard and a constant."""


@dataclass(frozen=True, slots=True)
class Integers:
    """name = op(args…); `array` is the number of the array for gather and length."""

    name: Annotated[str, Result("integer")]
    op: str
    args: Annotated[tuple[Arg, ...], INTEGER]
    array: int = -1


@dataclass(frozen=True, slots=True)
class Load:
    """name = array[subscripts…]."""

    name: Annotated[str, Result()]
    array: int
    subscripts: Annotated[tuple[Arg, ...], INTEGER]


@dataclass(frozen=True, slots=True)
class Number:
    """name = the integer, as a number."""

    name: Annotated[str, Result()]
    integer: Annotated[Arg, INTEGER]


@dataclass(frozen=True, slots=True)
class Run:
    """results = the outputs of a flat program on the inputs, in the order of its parameters."""

    program: Program
    inputs: Annotated[tuple[Arg, ...], NUMBER]
    results: Annotated[tuple[str, ...], Result(fixed=True)]


@dataclass(frozen=True, slots=True)
class Loop:
    """results = Σ values over `index` from lo up to hi - 1; `title` is what the index is called in the expression.

    With `listed`, which stands outside of loops only, iterations whose index is no entry of that index array are left out.
    """

    index: Annotated[str, Variable(("body",), "integer")]
    lo: Annotated[Arg, INTEGER]
    hi: Annotated[Arg, INTEGER]
    body: Annotated[tuple[Step, ...], Block()]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    title: str = ""
    listed: int = -1


@dataclass(frozen=True, slots=True)
class Least(Loop):
    """result = the index, as a number, of the least of `values` among the iterations where `eligible` is 1; -1 if there is none.

    The first of equal ones. NaN if `eligible` is NaN in an iteration, or the value where `eligible` is 1. One entry for each result.
    """

    eligible: Annotated[tuple[Arg, ...], Operand(at="body", each=True)] = ()


@dataclass(frozen=True, slots=True)
class Factors(Loop):
    """results = Π values over the iterations, in their order."""


@dataclass(frozen=True, slots=True)
class Cells(Loop):
    """results = ∫∫ over the unit square of the polynomials of the nearest candidate (`teg.numerics.cells`), candidates the iterations.

    `values` are the numbers of a candidate: guards, key, coefficients of each result; if `shape.order` is 1, the direction of all of
    these. `otherwise` are the coefficients of each result where there is no candidate, and their direction. `tables`, one for each
    result or none, are the derivatives of the result by every number of a candidate, which `Take` reads; `sizes`, one for each result or
    none, are bounds of the integrals of the absolute values.
    """

    values: Annotated[tuple[Arg, ...], Operand(at="body")]
    shape: Layout = SQUARE
    otherwise: Annotated[tuple[Arg, ...], NUMBER] = ()
    tables: Annotated[tuple[str, ...], Result("integer")] = ()
    sizes: Annotated[tuple[str, ...], Result()] = ()


@dataclass(frozen=True, slots=True)
class Gaps(Loop):
    """results = Σ terms over the gaps between `first` and `last` that the iterations do not cover; in the block `inside`, a gap is from
    `left` to `right`.

    `values` are, in this order: n places p, ascending, +inf for those that are not there; for each of the n + 1 pieces between neighbours
    of first, p₀, …, pₙ₋₁, last, with places beyond last moved there, whether the iteration covers it; what counts where that is a tie,
    which it is from TIE_FROM to TIE_TO; and 1 where borders nearly touch, so that it is not known to the tolerance where they cross: then
    it is missed. `doubtful`, if there is a name, is how many iterations are such.

    A tie on a piece shorter than TOUCH·(last - first), where borders only touch, is as the piece before it that is none, or else the piece
    behind it. Pieces and gaps (p, q) thinner than PIECE_EPS·max(|p|, |q|) are left out. Every result is NaN if first, last, a place, or
    whether a piece is covered is; 0 if first >= last, where no iteration is run. Iterations behind one that covers all of the line need
    not be.

    In a derivative ends move: `velocities` are those of the n places, `outer` those of first and last, and `moving` are the names of the
    velocities of left and right, which are those of what the ends are. All three are empty in other programs.
    """

    values: Annotated[tuple[Arg, ...], Operand(at="body")]
    first: Annotated[Arg, NUMBER] = 0.0
    last: Annotated[Arg, NUMBER] = 0.0
    left: Annotated[str, Variable(("inside",))] = ""
    right: Annotated[str, Variable(("inside",))] = ""
    inside: Annotated[tuple[Step, ...], Block()] = ()
    terms: Annotated[tuple[Arg, ...], Operand(at="inside", each=True)] = ()
    doubtful: Annotated[tuple[str, ...], Result()] = ()
    velocities: Annotated[tuple[Arg, ...], Operand(at="body")] = ()
    outer: Annotated[tuple[Arg, ...], NUMBER] = ()
    moving: Annotated[tuple[str, ...], Variable(("inside",))] = ()

    @property
    def places(self) -> int:
        """Returns how many places an iteration has."""
        return (len(self.values) - 3) // 3


TIE_FROM, TIE_TO = 0.25, 0.75
TOUCH = 1e-4


@dataclass(frozen=True, slots=True)
class Combined:
    """table = the derivatives of Σ weights·results by the numbers of a candidate: `of` are the tables that `Cells` have left for these
    results, all for the same candidates and forms.

    In the columns of forms it is the sum of weights times tables; an entry of 0 counts as 0 whatever its weight is. In those of
    coefficients, which are moments, it is the first of the tables. `shape` has the columns.
    """

    table: Annotated[str, Result("integer")]
    of: Annotated[tuple[str, ...], INTEGER]
    weights: Annotated[tuple[Arg, ...], NUMBER]
    shape: Layout


@dataclass(frozen=True, slots=True)
class SeenLoop(Loop):
    """A loop over candidates; iterations for which all of the row of a table of `Combined` is 0 add nothing, and may be left out."""

    table: Annotated[str, INTEGER] = ""


@dataclass(frozen=True, slots=True)
class Rows(Loop):
    """table = the values of each iteration, from lo = 0 on, in a row of their own; rows belong to the first axes of `arrays`."""

    values: Annotated[tuple[Arg, ...], Operand(at="body")]
    table: Annotated[str, Result("integer")] = ""
    arrays: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Blank:
    """table = `rows` times `columns` zeros, to be added to. Stands outside of loops; `arrays` as those of `Rows`."""

    table: Annotated[str, Result("integer")]
    rows: Annotated[Arg, INTEGER]
    columns: int
    arrays: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class AddTo:
    """table[row, column] += value, into a table of `Blank`, in a loop that takes nothing from it."""

    table: Annotated[str, INTEGER]
    row: Annotated[Arg, INTEGER]
    column: int
    value: Annotated[Arg, NUMBER]


@dataclass(frozen=True, slots=True)
class Take:
    """name = the number in a column of a row of a table. That of `Cells` has a row for each candidate, and one of the end of the range,
    which is for `otherwise`."""

    name: Annotated[str, Result()]
    table: Annotated[str, INTEGER]
    row: Annotated[Arg, INTEGER]
    column: int


@dataclass(frozen=True, slots=True)
class Scatter:
    """output[subscripts…] += value; `array` is the given array whose shape the output has."""

    output: int
    array: int
    subscripts: Annotated[tuple[Arg, ...], INTEGER]
    value: Annotated[Arg, NUMBER]


@dataclass(frozen=True, slots=True)
class Like:
    """An output that is an array of the shape of a given one, by its number."""

    array: int


Step = Integers | Load | Number | Run | Loop | Combined | Blank | AddTo | Take | Scatter


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """An array that is given: its name, any text, and how many dimensions it has."""

    name: str
    dimensions: int
    integers: bool


@dataclass(frozen=True)
class ArrayProgram:
    """Scalar parameters and arrays in order, steps, and outputs: a name or literal for a number, or an array that is scattered
    into."""

    parameters: tuple[str, ...]
    arrays: tuple[ArraySpec, ...]
    body: tuple[Step, ...]
    outputs: tuple[Arg | Like, ...]

    @cached_property
    def subscripted(self) -> tuple[Step, ...]:
        """Returns loops, integers, and one step for each place of an array or row of a table that is read or added to, in the order of the
        program: what every call looks at."""
        found: dict[object, Step] = {}
        for step in steps(self.body):
            match step:
                case Loop() | Integers():
                    found[id(step)] = step
                case Load() | Scatter():
                    found.setdefault((step.array, step.subscripts), step)
                case Take() | AddTo():
                    found.setdefault((step.table, step.row), step)
                case _:
                    pass
        return tuple(found.values())

    @cached_property
    def tables(self) -> dict[str, tuple[int, ...]]:
        """Returns the arrays whose first axes the rows of each table belong to."""
        return {s.table: s.arrays for s in steps(self.body) if isinstance(s, Rows | Blank)}


def steps(block: tuple[Step, ...]) -> Iterator[Step]:
    """Yields every step of a block and of the loops in it, outermost first."""
    stack = list(reversed(block))
    while stack:
        step = stack.pop()
        yield step
        for _, _, inner in inner_blocks(step):
            stack.extend(reversed(inner))


def scattered(block: tuple[Step, ...]) -> list[int]:
    """Returns the outputs that are scattered into, ascending."""
    return sorted({s.output for s in steps(block) if isinstance(s, Scatter)})


def work(block: tuple[Step, ...]) -> int:
    """Returns about how many operations a run of a block takes, loops inside counted as a hundred iterations: a fixed number, which decides
    how many chunks a loop is worth."""
    return sum(size(s.program) * 4 if isinstance(s, Run) else 100 * work(s.body) if isinstance(s, Loop) else 1 for s in block)


def array_size(program: ArrayProgram) -> int:
    """Returns the number of statements, those of the flat programs included."""
    return sum(size(s.program) if isinstance(s, Run) else 1 for s in steps(program.body))
