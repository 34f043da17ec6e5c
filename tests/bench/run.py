"""Measure: `make bench`. Medians of several runs; compare ratios of one run only, machines are noisy.

python tests/bench/run.py [--json FILE] [--page FILE] [--only NAME …]: tables as Markdown, and all of it in out/bench.json. About four
minutes. With `--page` the tables are written into a page, as in docs/performance.md; with `--only` those of these names, and the page keeps
its others.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
import teg
from teg.backends.c.standalone import standalone_c
from teg.examples.charts.tables import read_page, write_page
from tests.backends import isolate_surfaces, locate_pairs, programs
from tests.bench.backends import backend_rows
from tests.bench.closed import closed_rows
from tests.bench.cut_disks import cut_disk_rows
from tests.bench.functions import call_time_rows, swap_rows
from tests.bench.many import many_rows
from tests.bench.rasteriser import rasteriser_rows
from tests.bench.rows import (
    Row,
    compile_row,
    curved_row,
    empty_cache,
    evaluation_row,
    import_time,
    kink_row,
    median_time,
    search_row,
    sympy_rows,
    triangle_pairs,
)
from tests.bench.scenes import (
    TETRAHEDRON,
    ball_across_sides,
    ball_in_four,
    bilinear_pixel,
    disk,
    distances,
    half_planes,
    heart,
    heavisides,
    nested_sines,
    sphere,
    squares,
    superellipse,
    tetrahedron,
    triangle_pixel,
)
from tests.bench.speed import bilinear_rows, call_rows, compile_time_row, crossed_rows, image_rows, triangle_rows


def shown(number: Any) -> str:
    """Returns a number with three digits, without an exponent from 0.001 to 10⁶."""
    if not isinstance(number, float):
        return str(number)
    return f"{number:.0f}" if 1000 <= abs(number) < 1e6 else f"{number:.3g}"


def table(rows: list[Row]) -> str:
    """Rows as Markdown."""
    if not rows:
        return ABSENT
    heads = list(rows[0])
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for row in rows:
        cells = [shown(row[h]) for h in heads]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


ABSENT = "Not measured: a package that it is about is not installed (`pip install 'teg-compiler[peers]'` brings them)."
OUT = Path(__file__).resolve().parents[2] / "out" / "bench.json"


def compiled() -> list[Row]:
    """Sizes and times of compiling."""
    return [
        compile_row("triangle-pixel, constant colour", *triangle_pixel(0)),
        compile_row("triangle-pixel, linear colour", *triangle_pixel(1)),
        compile_row("12 half-planes", *half_planes(12)),
        *(compile_row(f"{n} Heavisides", *heavisides(n)) for n in (10, 100, 1000)),
    ]


def timed_compilation() -> list[Row]:
    """From the expression to C, and from C to machine code."""
    return [
        compile_time_row("1000 Heavisides", *heavisides(1000)),
        compile_time_row("triangle-pixel, linear colour", *triangle_pixel(1)),
        compile_time_row("triangle-pixel, quadratic colour", *triangle_pixel(2)),
        compile_time_row("thresholded bilinear pixel", *bilinear_pixel()),
    ]


def evaluated() -> list[Row]:
    """Value and gradient of polygons in pixels."""
    rows = []
    for order, colour in ((0, "constant"), (1, "linear")):
        for backend, n in (("c", 20_000), ("numpy", 2_000)):
            e, wrt = triangle_pixel(order)
            rows.append(evaluation_row(f"triangle-pixel, partial cover, {colour}", e, wrt, triangle_pairs(n, order), backend))
    return rows


def curved() -> list[Row]:
    """Surfaces that are no lines."""
    return [
        curved_row("disk", *disk(), {"t": 0.5, "a": 0.1, "b": -0.2}, 2_000, True),
        curved_row("superellipse", *superellipse(), {"t": 0.4, "a": 1.3}, 1_000, True),
        curved_row("heart", *heart(), {"t": 1.0}, 100, False),
        curved_row("sphere", *sphere(), {"t": 0.5}, 100, True),
        curved_row("ball across sides", *ball_across_sides(), {"t": 0.86, "a": -0.29, "b": 0.13}, 100, False),
        curved_row("tetrahedron in a box", *tetrahedron(), TETRAHEDRON, 100, False),
        curved_row("ball in four variables", *ball_in_four(), {"t": 0.5}, 1, False),
    ]


def searches() -> list[Row]:
    """Roots isolated at run time, and places located."""
    n = 20_000
    p = np.random.default_rng(3).uniform(0.2, 0.8, n)

    def roots(g: isolate_surfaces.Surface, lo: float, hi: float) -> Any:
        names = isolate_surfaces.numbered(12)
        return programs.program(1, (isolate_surfaces.isolate(names, g, lo, hi),), *names.split())

    circles = locate_pairs.locate("vr0 vr1", locate_pairs.two_circles(0.5, "p0", 1.0, 1.0), -2.0, 3.0, -1.5, 1.75)
    return [
        search_row("roots of a line", roots(isolate_surfaces.line(2.0, "p0"), 0.0, 1.0), [p]),
        search_row("roots of x³ - p·x", roots(isolate_surfaces.cubic("p0"), -1.0, 1.5), [p]),
        search_row("roots of sin(7x + p)", roots(isolate_surfaces.wave(7.0, "p0"), -1.0, 1.0), [p]),
        search_row("places of two circles", programs.program(1, (circles,), "vr0", "vr1"), [p[:1000]]),
    ]


def single() -> list[Row]:
    """Numbers that stand alone."""
    x, t = teg.var("x"), teg.param("t")
    scalar = teg.compile(teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), [t], backend="c")
    e, wrt = triangle_pixel(1)
    source, _ = standalone_c(teg.compile(e, wrt, backend="c").program(1), "pixel")
    return [
        {"number": "one scalar call, C backend, µs", "is": 1e6 * median_time(lambda: [scalar(t=0.5) for _ in range(1000)]) / 1000},
        {"number": "lines of C, value and gradient of triangle-pixel, linear colour", "is": len(source.splitlines())},
        {"number": "import teg, s", "is": import_time()},
    ]


Measurement = Callable[[], list[Row]]
TABLES: dict[str, tuple[Measurement, str]] = {
    "triangle and pixel": (
        lambda: [row for order in range(3) for row in triangle_rows(order)],
        "Loss and full gradient of one triangle and one pixel, generated C beside C written by hand for this one integral. `error` is "
        "the largest difference of the two; `error to 60 digits` is that of the generated program.",
    ),
    "picture": (
        image_rows,
        "Loss and gradient by all vertices and colours of triangles side by side, every pixel of every bounding box.",
    ),
    "half-planes in a box": (
        crossed_rows,
        "Value and gradient of polynomials on half-planes, eight boxes at once, beside one at a time.",
    ),
    "bilinear pixel": (bilinear_rows, "A thresholded bilinear pixel, by the number of branches of its hyperbola inside."),
    "curved": (curved, "Surfaces that are no lines, and a tetrahedron, in C; second derivatives where they are asked for."),
    "disks and lines": (
        cut_disk_rows,
        "The area of a disk that lines cut, in a square: moments in closed form, and the same with `intrinsics=False`.",
    ),
    "closed forms": (closed_rows, "Integrals whose antiderivative is known: value and gradient of one element of a batch."),
    "many surfaces": (
        many_rows,
        "Scenes of many surfaces, and pictures integrated over a third variable. Processor time of one thread, without "
        "compilation; a product is that of the Hessian and a direction; the largest error in a "
        "sample of pixels. The references share nothing with the compiler: a clipper of convex polygons, the sum of the masses of power "
        "cells, a determinant, and the midpoint rule over time or lens, whose own error the last two rows show.",
    ),
    "beside a rasteriser": (
        rasteriser_rows,
        "Loss and gradient by all places and colours of 512² pixels of three channels, beside "
        "[DEODR](https://github.com/martinResearch/DEODR), an approximate differentiable rasteriser in C: one thread, runs in turn. "
        "It takes the colour at the middle of a pixel, mixes occluding edges with what is behind them, and differentiates that "
        "picture; here a pixel is the integral. `off` is relative to the size of the exact answer; a motion of all places is compared "
        "with differences of the exact loss. `lists` are the candidates of pixels, found by NumPy, which it does not need. Mitsuba, "
        "which samples paths of light at random, is not measured.",
    ),
    "backends": (
        backend_rows,
        "From the expression to the first value and gradient with nothing in the cache, and the time of each element of a batch of 4096. "
        "JAX calls the C kernel here, on all cores; the other columns are of one thread.",
    ),
    "evaluate": (evaluated, "Value and gradient of triangles that cut their pixel, through Python, one thread."),
    "calls": (call_rows, "What a call from Python costs beside its kernel."),
    "compile": (compiled, "Sizes, and the time from an expression to the statements of its gradient."),
    "compile time": (timed_compilation, "From an expression to C, and from C to machine code, both of value and gradient."),
    "kinks": (lambda: [kink_row(n, *distances(n)) for n in (8, 20)], "A condition with kinks, to its first gradient in NumPy."),
    "functions": (swap_rows, "Shaders as compiled functions: a scene with one shader, and the same with four others in turn."),
    "calls of functions": (call_time_rows, "What a call of a compiled function costs, beside the same body in line."),
    "search": (searches, "One search for roots, or for the places where curves meet."),
    "sympy": (lambda: sympy_rows(nested_sines(100_000), squares(2_000)), "To SymPy and back."),
    "single": (single, "Numbers that stand alone."),
}
"""What is measured, and what its table shows."""


def heading(name: str) -> str:
    """Returns the heading of a table."""
    return f"### {name[0].upper()}{name[1:]}"


def kept(page: str, name: str) -> list[str]:
    """Returns the section of a page that has a table, if there is one."""
    _, _, after = page.partition(f"{heading(name)}\n")
    section = re.split(r"^(?:###|<!-- end bench)", after, maxsplit=1, flags=re.MULTILINE)[0]
    return [f"{heading(name)}\n{section}".rstrip() + "\n"] if after else []


def main() -> None:
    """Print the tables; write them as JSON too."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--json", type=Path, default=OUT, help="where to (default: %(default)s)")
    arguments.add_argument("--page", type=Path, help="a page between whose lines for `make bench` the tables are written")
    arguments.add_argument(
        "--only", nargs="+", choices=TABLES, default=list(TABLES), help="the tables to measure (default: all)", metavar="NAME"
    )
    chosen = arguments.parse_args()
    start = time.perf_counter()
    page = read_page(chosen.page)
    found: dict[str, Any] = {}
    sections = []
    for name, (measure, shown) in TABLES.items():
        if name not in chosen.only:
            sections += kept(page, name)
            continue
        with empty_cache():
            found[name] = measure()
        sections.append(f"{heading(name)}\n\n{shown}\n\n{table(found[name])}\n")
        sys.stdout.write(sections[-1] + "\n")
        sys.stdout.flush()
    machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": os.cpu_count()}
    chosen.json.parent.mkdir(parents=True, exist_ok=True)
    chosen.json.write_text(json.dumps({"machine": machine, **found}, indent=1, ensure_ascii=False), encoding="utf-8")
    if chosen.page:
        write_page(chosen.page, page, "bench", "\n".join(sections), "make bench")
    sys.stdout.write(f"{time.perf_counter() - start:.0f} s in all; {chosen.json}\n")


if __name__ == "__main__":
    main()
