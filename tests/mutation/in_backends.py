"""Single wrong changes of backends."""

from __future__ import annotations

from tests.mutation.mutant import JAX, Mutant, mutants

RANGES = "tests/backends/c/test_ranges.py"
CELLS = "tests/backends/c/test_cells.py"
KEPT = "tests/backends/c/test_kept_cells.py"
POLYHEDRON = "tests/backends/test_polyhedron.py"
ENVELOPE = "tests/backends/c/test_envelope.py"
SIDE_BY_SIDE = "tests/backends/numpy/test_side_by_side.py"
SIDE_LINES = "tests/numerics/test_side_lines.py"
KERNEL_IN_JAX = "tests/backends/jax/test_kernel.py"

IN_BACKENDS: tuple[Mutant, ...] = (
    Mutant(
        "programs before cells side by side",
        "backends/c/eights.py",
        "for s in loop.body[: loop.body.index(own)] if",
        "for s in loop.body[:0] if",
        ("tests/backends/c/test_eights.py",),
    ),
    Mutant(
        "one that covers before one with lines",
        "backends/c/runtime/eights.h",
        "hidden | (front & (other == 1))",
        "hidden | front",
        ("tests/backends/c/test_eights.py",),
    ),
    Mutant(
        "means that are equal by chance",
        "backends/c/runtime/samples.h",
        "hidden ? fmax(square, variance / (each * each)) : square",
        "square",
        ("tests/backends/test_sampled.py",),
    ),
    Mutant(
        "errors of means that are equal by chance",
        "backends/shared/samples.py",
        "xp.where(hidden, variance / each**2, 0.0)",
        "xp.where(hidden, variance / each, 0.0)",
        ("tests/backends/test_sampled.py",),
    ),
    *mutants(
        "backends/c/runtime/fans.h",
        ("tests/backends/c/test_eights.py",),
        ("a common edge by the farther one", "-1.0 / t->size[i][k] : scale[k]", "-1.0 / t->size[j][k] : scale[k]"),
        ("moments of the upper side", "(upper ? total - j : j)", "j"),
        ("edges without another region", "t->good[k] &= t->matches[i][k] == 1.0;", "t->good[k] &= t->matches[i][k] >= 0.0;"),
    ),
    Mutant(
        "all of eight without candidates",
        "backends/c/eights.py",
        'f"some |= {spelled(cells.hi)}',
        'f"some = {spelled(cells.hi)}',
        ("tests/backends/c/test_eights.py",),
    ),
    *mutants(
        "backends/c/ranges.py",
        (RANGES,),
        ("a number that falls", "return _sum([args[0], args[1].times(-1.0)])", "return _sum(args)"),
        ("sizes along rows", "return _Bend(True, False, False) if", "return _Bend(True, True, False) if"),
        (
            "either of two conditions",
            "{h: None for h in moving[0].heights if all(h in p.heights for p in moving)}",
            "dict(moving[0].heights)",
        ),
    ),
    *mutants(
        "backends/c/spans.py",
        (RANGES, "tests/backends/c/test_pixels.py"),
        ("the last live iteration", "stop = floor(stop) + 1.0", "stop = floor(stop)"),
        ("the first covered iteration", "since = floor(since) + 1.0", "since = floor(since) - 1.0"),
    ),
    Mutant(
        "two borders in one line",
        "backends/c/spans.py",
        "crossing == 1.0 ? alone",
        "crossing >= 1.0 ? alone",
        ("tests/backends/c/test_pixels.py",),
        "the straight line of one half-plane is good only where the others hold; other points are computed as they are",
    ),
    *mutants(
        "backends/c/cells.py",
        (CELLS, ENVELOPE, KEPT),
        ("moments of a square", "literal(1.0 / ((u + 1) * (v + 1)))", "literal(1.0 / (u + v + 1))"),
        ("cells that are intervals", "not shape.order and all(step.values[j] == 0.0 for j in of_second)", "not shape.order"),
        ("candidates without edges", '{spelled(cells.lo)}] == 1"', '{spelled(cells.lo)}] >= 1"'),
    ),
    *mutants(
        "backends/c/crossed.py",
        ("tests/backends/c/test_crossed.py",),
        ("where a part begins", "start = w.select(rises, w.upper(start, root), start)", "start = w.select(rises, root, start)"),
        ("which boxes are run", "w.positive(w.sub(larger, size))", "w.positive(w.add(larger, size))"),
        ("half of a side", "extent = length if line.tied is False else w.select(line.tied, half, length)", "extent = length"),
    ),
    *mutants(
        "backends/c/runtime/cells.h",
        (CELLS, KEPT),
        ("mean of two squares", "for (size_t k = 0; k < size; k++) tables[k] *= 0.5;", ""),
    ),
    *mutants(
        "backends/c/runtime/measures.h",
        (CELLS, KEPT),
        ("a corner that moves", "p[i] = (s * two->b - one->b * t) / across", "p[i] = (s * two->b + one->b * t) / across"),
        ("bound of an integrand", "size += fabs(own[j])", "size += own[j]"),
    ),
    *mutants(
        "backends/c/runtime/cells.h",
        ("tests/ir/test_choices.py",),
        ("the first of equal keys", "key < *least", "key <= *least"),
    ),
    *mutants(
        "backends/c/runtime/insertion.h",
        ("tests/end_to_end/test_site_grids.py",),
        ("keys that meet in a corner", "equal + teg_sides_at(x, y) > 4 ? 2 : 1", "1"),
        ("keys that meet", "r->concurrent = equal", "r->touching = equal"),
    ),
    *mutants(
        "backends/numpy/arrangement.py",
        ("tests/backends/numpy/test_cells.py",),
        ("keys that meet on a side", "np.where(equal + _sides_at(at) > 4, 2, 1)", "np.where(equal > 4, 2, 1)"),
    ),
    *mutants(
        "backends/shared/rules.py",
        ("tests/end_to_end/test_cancelling.py",),
        (
            "errors of what cancels",
            "xp.minimum(SPENT * tolerated(xp, tolerance, whole, whole), cancelled)",
            "SPENT * tolerated(xp, tolerance, whole, whole)",
        ),
    ),
    *mutants(
        "backends/c/runtime/quadrature.h",
        ("tests/end_to_end/test_cancelling.py",),
        ("errors of what cancels in C", "least = wanted < left ? wanted : left;", "least = wanted;"),
    ),
    *mutants(
        "backends/c/runtime/envelope.h",
        (ENVELOPE,),
        ("jump between two intervals", "jump /= key->rate - key[1].rate;", "jump /= key[1].rate - key->rate;"),
        ("present on a part of an interval", "if (!(most < -margin && least > -INFINITY)) return -1;", ""),
        ("moments of an interval", "powers = powers * to + power;", "powers = powers * to;"),
    ),
    *mutants(
        "backends/numpy/key_edges.py",
        ("tests/backends/numpy/test_key_edges.py",),
        ("a key that is less beyond", "<= tolerance) & (slope > flat)", "<= tolerance)"),
    ),
    *mutants(
        "backends/numpy/side_lines.py",
        (SIDE_LINES,),
        ("squares with several lines on a side", "> 1.0", "> 2.0"),
    ),
    *mutants(
        "backends/c/runtime/side_lines.h",
        (SIDE_LINES,),
        ("colours of lines over one another", "else if (common > TEG_BESIDE) taken", "else if (common > 2.0) taken"),
        ("regions beyond a side", "!= (lines[k].side & 1)", "!= 0"),
    ),
    *mutants(
        "backends/shared/cells.py",
        (SIDE_LINES,),
        ("lines on a side that move alone", "sides[1] | (others & inner[..., None])", "sides[1]"),
    ),
    *mutants(
        "backends/numpy/side_by_side.py",
        (SIDE_BY_SIDE,),
        ("points of a later block", "left.append(start + self._computed(", "left.append(self._computed("),
        ("points that are not good", "chosen[~np.broadcast_to(good, chosen.shape)]", "chosen[:0]"),
        ("points with results", "row[chosen] = output", "row[: len(chosen)] = output"),
    ),
    *mutants(
        "backends/jax/adaptive.py",
        (KERNEL_IN_JAX, JAX),
        ("intervals that are halved", "sums=jnp.where(done, at.sums + total, at.sums)", "sums=at.sums + total"),
        ("the next interval", "width=jnp.where(done, start & -start, halved)", "width=jnp.where(done, 2 * at.width, halved)"),
    ),
    *mutants(
        "backends/jax/while_loops.py",
        ("tests/backends/jax/test_while_loops.py",),
        ("a batch that goes on", "[jnp.any(conditions(*v))]", "[jnp.all(conditions(*v))]"),
        ("elements at their end", "[lax.select(*three) for three in zip(which, found, carried, strict=True)]", "found"),
    ),
    *mutants(
        "backends/jax/entries.py",
        ("tests/backends/jax/test_entries.py",),
        ("places in an array", " and other.place == first.place + distance", ""),
    ),
    *mutants(
        "backends/jax/corners.py",
        ("tests/backends/jax/test_corners.py",),
        ("corners between two that are cut off", "found = upwards | downwards", "found = upwards"),
    ),
    *mutants(
        "backends/jax/cells.py",
        ("tests/backends/jax/test_cells.py",),
        ("the row behind the last candidate", "behind = jnp.arange(most + 1) == counts[:, None]", "behind = jnp.arange(most + 1) == most"),
    ),
    *mutants(
        "backends/c/runtime/polyhedron.h",
        (POLYHEDRON,),
        ("place of a cut", "t = high / (high - height[out])", "t = 0.5"),
        ("way around a new face", "{f, number, leaves[f], enters[f]}", "{f, number, enters[f], leaves[f]}"),
        ("both sides of an edge", "twice[e->other][j] -= across[j]", "twice[e->other][j] += across[j]"),
    ),
    *mutants(
        "backends/shared/polyhedra.py",
        (POLYHEDRON,),
        ("where a face is entered", "xp.where(row, xp.sum(back, axis=2)[:, None]", "xp.where(row, xp.sum(new, axis=2)[:, None]"),
    ),
    *mutants(
        "backends/lazily.py",
        ("tests/backends/test_lazily.py",),
        ("where a statement is run", "frozenset({(when, True)} if when", "frozenset({(when, False)} if when"),
        ("what a statement is where it is not run", "stmt.when != condition or any(absent(stmt).values())", "stmt.when != condition"),
    ),
    *mutants(
        "backends/numpy/gaps.py",
        ("tests/backends/test_gaps.py",),
        ("a touch at the begin of a line", "np.where(before < 0, behind, before)", "before"),
        ("intervals inside of others", "np.maximum(reached[at], q[at])", "q[at]"),
        ("the velocity of what is reached", "np.where(q[at] > reached[at], velocities[1][at], before[at])", "velocities[1][at]"),
    ),
    *mutants(
        "backends/c/runtime/gaps.h",
        ("tests/backends/test_gaps.py",),
        ("intervals inside of others, in C", "if (q > end)", "if (1)"),
        ("the velocity of what is reached, in C", "end = q, velocity = ends;", "end = q;"),
        ("borders that nearly touch, in C", "g->doubtful += ties[n + 1] > 0.0;", ""),
        ("a candidate that covers a part, in C", "g->closed &= before > TEG_TIE_TO || p >= q;", ""),
    ),
    *mutants(
        "backends/c/delayed.py",
        ("tests/backends/c/test_delayed.py",),
        (
            "what the end of a line is made of",
            "{step.first, step.last, step.lo, step.hi, *step.outer}",
            "{step.first, step.lo, step.hi, *step.outer}",
        ),
        (
            "what others read",
            "if len(sums) == 1 and (only := sums.pop()) is not None:",
            "if sums - {None} and (only := (sums - {None}).pop()) is not None:",
        ),
    ),
    *mutants(
        "backends/shared/roots.py",
        ("tests/backends/numpy/test_isolate.py",),
        ("boxes in which rounding decides the sign", "bent_up, noise = bounds\n", "bent_up, noise = (*bounds[:6], 0.0)\n"),
    ),
    *mutants(
        "backends/shared/roots.py",
        ("tests/backends/numpy/test_isolate.py",),
        ("boxes in which a function is 0", "((least == 0.0) & (most == 0.0))", "False"),
    ),
)
