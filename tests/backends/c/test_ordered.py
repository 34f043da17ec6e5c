"""The order of the operations of a straight line."""

from __future__ import annotations

import random

from teg.backends.c.ordered import LONGEST, REGISTERS, ordered
from teg.program import Assign


def random_line(size: int, seed: int) -> list[Assign]:
    """Returns sums, products and quotients of inputs and of earlier values."""
    rng = random.Random(seed)
    names: list[str] = [f"p{i}" for i in range(5)]
    block: list[Assign] = []
    for n in range(size):
        args = tuple(rng.choice(names[-40:]) for _ in range(rng.choice((1, 2, 2, 3))))
        block.append(Assign(f"v{n}", "neg" if len(args) == 1 else rng.choice(("add", "mul", "div")) if len(args) == 2 else "add", args))
        names.append(block[-1].name)
    return block


def test_operands_stand_first_and_nothing_is_lost() -> None:
    for seed in range(20):
        block = random_line(200, seed)
        wanted = [s.name for s in block[-3:]]
        lines, names = ordered(block, wanted)
        assert set(lines) <= set(block)
        assert len({s.name for s in lines}) == len(lines)
        known = {f"p{i}" for i in range(5)}
        for s in lines:
            assert known.issuperset(s.args)
            known.add(s.name)
        assert known.issuperset(wanted)
        assert set(names).issuperset(wanted)
        assert {a for s in lines for a in s.args}.union(wanted).issuperset(s.name for s in lines)  # what nothing reads is left out


def test_chains_stand_between_one_another() -> None:
    """Two chains of products take turns: one alone would wait for each of its results."""
    block = [Assign(f"v{chain}{n}", "div", (f"v{chain}{n - 1}" if n else f"p{chain}", "p2")) for chain in (0, 1) for n in range(8)]
    lines, _ = ordered(block, ["v07", "v17"])
    chains = [s.name[1] for s in lines]
    longest = max(len(run) for run in "".join(chains).replace("01", "0 1").replace("10", "1 0").split())
    assert longest <= LONGEST


def test_few_values_are_alive_at_once() -> None:
    """A thousand products of two inputs each, added up one after the other, never wait together."""
    block: list[Assign] = []
    total = "p0"
    for n in range(0, 4000, 4):
        block.append(Assign(f"v{n}", "mul", ("p0", "p1")))
        block.append(Assign(f"v{n + 1}", "mul", (f"v{n}", f"v{n}")))
        block.append(Assign(f"v{n + 2}", "add", (total, f"v{n + 1}")))
        total = f"v{n + 2}"
    lines, _ = ordered(block, [total])
    uses = {a: n for n, s in enumerate(lines) for a in s.args}
    alive = most = 0
    ends: dict[int, int] = {}
    for n, s in enumerate(lines):
        alive += 1 - ends.pop(n, 0)
        last = uses.get(s.name, n)
        ends[last] = ends.get(last, 0) + 1
        most = max(most, alive)
    assert most <= REGISTERS + LONGEST
