"""The straight line of points that surfaces cross as C: what it reads, and what is computed once for all that wait."""

from __future__ import annotations

import re

import pytest

import teg
from teg.backends.branches import with_branches
from teg.backends.c.crossed import crossed
from teg.backends.c.stages import functions, results
from teg.program import Program
from tests.backends.c_checks import in_c
from tests.bench.scenes import picture, triangle_pixel

pytestmark = [*in_c, pytest.mark.filterwarnings("error")]


def test_what_is_the_same_at_all_points_is_computed_apart() -> None:
    program = teg.compile(*triangle_pixel(1), backend="numpy").program(1)
    assert isinstance(program, Program)
    found = crossed(with_branches(program))
    assert found is not None
    names = program.parameters
    boxes = {names.index(name) for name in ("left", "right", "bottom", "top", "t0", "t1", "t2")}
    some, every = (functions([found], varying, results) for varying in (boxes, range(len(names))))
    assert not boxes.intersection(some.steady.inputs)
    assert boxes.issubset(some.lines[0].inputs)
    assert some.kept > 20
    assert len(some.steady.text) > 60
    assert len(some.lines[0].text) < len(every.lines[0].text) - 40
    assert every.steady.inputs == []


def test_in_a_picture_it_is_computed_once_for_each_face() -> None:
    """Once for the pixels that an edge crosses, and once for those that none does, for eight faces at a time."""
    e, wrt = picture()
    source = teg.compile(e, wrt, backend="c").source
    for kind in ("crossed", "covered"):
        ((name, at),) = [(m.group(1), m.start()) for m in re.finditer(rf"(?<=\n)TEG_EIGHT void ({kind}_\d+)\(", source)]
        (steady,) = re.findall(r"(?<=\n)TEG_EIGHT void (steady_\d+)\(", source[at:])[:1]
        assert len(re.findall(rf"\b{steady}\(", source)) == 2  # the function, and its call
        assert len(re.findall(rf"\b{name}\(", source)) == 3  # the function, where the queue is full, and at the end


def test_what_is_only_added_up_is_added_where_it_is_computed() -> None:
    source = teg.compile(*picture(), backend="c").source
    assert "lanes[0][k] += added ? " in source
    assert "double f[128]" not in source
