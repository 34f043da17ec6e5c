"""Products in sums as one operation: the same values in exact arithmetic, and decisions as they were."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import prod

import numpy as np
import pytest

import teg
from teg.backends.branches import with_branches
from teg.backends.c.contracted import contracted, decisive
from teg.backends.c.crossed import crossed
from teg.backends.c.crossing import LARGEST
from teg.backends.c.items import Item, Nodes
from teg.program import Arg, Assign, Program
from tests.bench.scenes import triangle_pixel

INPUTS = ("p0", "p1", "p2")


def exactly(block: Sequence[Assign]) -> dict[str, Fraction]:
    """All values of a block in exact arithmetic."""
    known = {"p0": Fraction(3, 7), "p1": Fraction(-5, 3), "p2": Fraction(11, 13)}

    def of(arg: Arg) -> Fraction:
        return known[arg] if isinstance(arg, str) else Fraction(arg)

    for s in block:
        args = [of(a) for a in s.args]
        match s.op:
            case "add":
                known[s.name] = sum(args, start=Fraction(0))
            case "sub":
                known[s.name] = args[0] - args[1]
            case "mul":
                known[s.name] = prod(args, start=Fraction(1))
            case "neg":
                known[s.name] = -args[0]
            case "fma":
                known[s.name] = args[0] * args[1] + args[2]
            case _:
                raise AssertionError(s.op)
    return known


def random_block(seed: int, size: int = 120) -> list[Assign]:
    """Sums, differences, products and signs of what stands before."""
    rng = np.random.default_rng(seed)
    block: list[Assign] = []
    for n in range(size):
        names: list[Arg] = [*INPUTS, *(s.name for s in block[-60:]), 0.5, -2.0]
        op = str(rng.choice(["add", "add", "sub", "mul", "mul", "mul", "neg"]))
        count = {"neg": 1, "sub": 2}.get(op) or int(rng.integers(2, 5))
        block.append(Assign(f"v{n}", op, tuple(names[i] for i in rng.integers(0, len(names), count))))
    return block


@pytest.mark.parametrize("seed", range(20))
def test_the_values_are_the_same(seed: int) -> None:
    block = random_block(seed)
    kept, exact = {"v39", "v38", "v17"}, {"v5", "v6", "v20", "v21", "v22"}
    made = contracted(block, kept, exact)
    assert any(s.op == "fma" for s in made)
    before, after = exactly(block), exactly(made)
    assert kept <= after.keys()
    assert all(before[name] == value for name, value in after.items() if name in before)
    lines = {s.name: s for s in made}
    assert all(lines[s.name] == s for s in block if s.name in exact and s.name in lines)
    names = [s.name for s in made]
    assert len(set(names)) == len(names)


def test_sums_of_products() -> None:
    """A product that is read once joins the sum; one that is read twice, or elsewhere, does not."""
    products = [Assign(f"v{n}", "mul", (f"p{n}", "p0")) for n in range(3)]
    total = Assign("v3", "add", ("v0", "v1", "v2", "p1"))
    assert [s.op for s in contracted([*products, total], {"v3"}, set())] == ["fma", "fma", "fma"]
    assert [s.op for s in contracted([*products, total], {"v3", "v1"}, set())] == ["mul", "add", "fma", "fma"]
    assert contracted([*products, total], {"v3"}, {"v3"}) == [*products, total]
    assert contracted([*products, total], {"v3"}, {"v0", "v1", "v2"}) == [*products, total]


def test_differences_are_left_alone() -> None:
    """That of equal products is 0, which one rounding less would not give."""
    products = [Assign(f"v{n}", "mul", (f"p{n}", "p0")) for n in range(2)]
    for block in (
        [*products, Assign("v3", "sub", ("v0", "v1"))],
        [*products, Assign("v2", "neg", ("v1",)), Assign("v3", "add", ("v0", "v2"))],
        [products[0], Assign("v2", "neg", ("p1",)), Assign("v3", "add", ("v0", "v2"))],
    ):
        assert contracted(block, {"v3"}, set()) == block


def test_what_conditions_read() -> None:
    nodes = Nodes({"v9": (0.5,)}, (1.0,), (Assign("v8", "mul", ("v9", "v0")),), ("v8",), ("v7",))
    size = [Assign("v20", "abs", ("v6",)), Assign("v21", "sub", ("v20", LARGEST)), Assign("b1", "le0", ("v21",))]
    items: list[Item] = [
        Assign("v0", "add", ("p0", "p1")),
        Assign("v1", "mul", ("p2", "p1")),
        nodes,
        Assign("b0", "gt0", ("v7",)),
        Assign("v6", "add", ("v1", "v7")),
        *size,
    ]
    assert {"v0", "v7", "v8"} <= decisive(items)
    assert decisive(items).isdisjoint({"v1", "v6", "v20", "v21"})


def test_decisions_of_a_picture_are_left_alone() -> None:
    """In the line of pixels that edges cross, no operand of a condition is rounded otherwise."""
    program = teg.compile(*triangle_pixel(1), backend="numpy").program(1)
    assert isinstance(program, Program)
    found = crossed(with_branches(program))
    assert found is not None
    exact = decisive(found.items)
    block = [i for i in found.items if isinstance(i, Assign)]
    made = {s.name: s for s in contracted(block, {a for i in found.items if isinstance(i, Nodes) for a in i.reads}, exact)}
    assert sum(s.op == "fma" for s in made.values()) > 50
    assert all(made[s.name] == s for s in block if s.name in exact)
