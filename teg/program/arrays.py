"""The program of an expression with arrays and sums: loops around flat programs.

    step ::= name = op(i, …)                        Integers: an integer of indices, lengths, integer parameters, entries of index arrays
           | name = A[i, …]                         Load: an entry of an array of parameters
           | name = i                               Number: an integer as a float64
           | names = kernel(names…)                 Run: a flat program (`teg.program`) on numbers
           | names = Σ i in [lo, hi): steps         Loop: each result is the sum of its value over the iterations
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
from typing import Annotated

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
    """results = Σ values over `index` from lo up to hi - 1; `title` is what the index is called in the expression."""

    index: Annotated[str, Variable(("body",), "integer")]
    lo: Annotated[Arg, INTEGER]
    hi: Annotated[Arg, INTEGER]
    body: Annotated[tuple[Step, ...], Block()]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    title: str = ""


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


Step = Integers | Load | Number | Run | Loop | Scatter


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """An array that is given: its name, any text, and how many dimensions it has."""

    name: str
    dimensions: int
    integers: bool


@dataclass(frozen=True, slots=True)
class ArrayProgram:
    """Scalar parameters and arrays in order, steps, and outputs: a name or literal for a number, or an array that is scattered
    into."""

    parameters: tuple[str, ...]
    arrays: tuple[ArraySpec, ...]
    body: tuple[Step, ...]
    outputs: tuple[Arg | Like, ...]


def steps(block: tuple[Step, ...]) -> Iterator[Step]:
    """Every step of a block and of the loops in it, outermost first."""
    stack = list(reversed(block))
    while stack:
        step = stack.pop()
        yield step
        for _, _, inner in inner_blocks(step):
            stack.extend(reversed(inner))


def scattered(block: tuple[Step, ...]) -> list[int]:
    """The outputs that are scattered into, ascending."""
    return sorted({s.output for s in steps(block) if isinstance(s, Scatter)})


def work(block: tuple[Step, ...]) -> int:
    """About how many operations a run of a block takes, loops inside counted as a hundred iterations: a fixed number, which decides how
    many chunks a loop is worth."""
    return sum(size(s.program) * 4 if isinstance(s, Run) else 100 * work(s.body) if isinstance(s, Loop) else 1 for s in block)


def array_size(program: ArrayProgram) -> int:
    """Number of statements, those of the flat programs included."""
    return sum(size(s.program) if isinstance(s, Run) else 1 for s in steps(program.body))
