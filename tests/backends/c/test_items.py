"""What a straight line consists of: which names an item reads and defines, and which items are needed."""

from __future__ import annotations

from teg.backends.c.items import Nodes, defines, needed, reads
from teg.program import Assign

SUMS = Nodes(
    {"vx": (-1.0, 1.0), "vy": (0.0, 2.0)},
    (0.5, "vw"),
    (Assign("vs", "mul", ("vx", "va")), Assign("vt", "mul", ("vy", "vb"))),
    ("vs", "vt"),
    ("vsum", "vtotal"),
)
A, B, W = (Assign(name, "add", ("p0", float(i))) for i, name in enumerate(("va", "vb", "vw")))


def test_names_that_an_item_reads_and_defines() -> None:
    assert (reads(A), defines(A)) == ({"p0", 0.0}, ("va",))
    assert defines(SUMS) == ("vsum", "vtotal")
    assert reads(SUMS) == {"va", "vb", "vw", 0.5}, "neither the places of a node nor what is computed there"


def test_items_that_are_needed() -> None:
    items = (A, B, W, SUMS, Assign("vunused", "neg", ("vtotal",)))
    one = Nodes({"vx": (-1.0, 1.0)}, (0.5, "vw"), SUMS.body[:1], ("vs",), ("vsum",))
    assert needed(items, ["vsum"]) == [A, W, one], "of the sums and of what they are made of"
    assert needed(items, ["vsum", "vtotal"]) == [A, B, W, SUMS]
    assert needed(items, ["va", 1.0]) == [A]
    assert needed(items, []) == []
