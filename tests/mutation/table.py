"""Single wrong changes of the compiler, each with the quick tests that must notice it."""

from __future__ import annotations

from tests.mutation.in_analyses import IN_ANALYSES
from tests.mutation.in_backends import IN_BACKENDS
from tests.mutation.in_passes import IN_PASSES
from tests.mutation.mutant import JAX, NUMPY, SMALL, C, Mutant, mutants

__all__ = ["MUTANTS", "Mutant"]

SUBSTITUTED = ("tests/backends/test_bends.py", NUMPY)
PASSES = (SMALL, NUMPY)
MUTANTS: tuple[Mutant, ...] = (
    *mutants(
        "teg/passes/normalise/finite_bounds.py",
        ("tests/passes/normalise/test_finite_bounds.py",),
        (
            "sign of an integral from infinity",
            "return mul(MINUS_ONE, cast(Expr, _visit(",
            "return mul(MINUS_ONE, MINUS_ONE, cast(Expr, _visit(",
        ),
        ("rate of a finite place", "integral_over(mul(rate, cast(", "integral_over(mul(cast("),
    ),
    *mutants(
        "teg/passes/normalise/sums.py",
        (SMALL, "tests/passes/normalise/test_sums.py", "tests/ir/test_arrays.py"),
        ("other branch around sums", "(where(e.condition, ZERO, ONE), e.otherwise)", "(where(e.condition, ONE, ZERO), e.otherwise)"),
        ("other branch around sums left out", "if branch is not ZERO:", "if branch is e.then:"),
        ("factor around sums", "stack.append((chain, mul(factor, others), cast", "stack.append((chain, others, cast"),
        ("last term of a sum", "for j in range(most):", "for j in range(most - 1):"),
    ),
    *mutants(
        "teg/passes/normalise/too_many_steps.py",
        (SMALL,),
        ("a moving condition on steps", "isinstance(node, UncountedFloor | Compare)", "isinstance(node, UncountedFloor)"),
        ("steps that are too many", "children[i] = _no_number(", "children[i] = ("),
    ),
    *mutants(
        "teg/analysis/sift.py",
        ("tests/analysis/test_sift.py",),
        ("coefficient of a delta in a product", "{chain: mul(k, *others) for chain", "{chain: k for chain"),
        ("coefficient of a delta in a branch", "(negation(node.condition), node.otherwise))", "(node.condition, node.otherwise))"),
        ("order of a nest", "parts[node] = {(binder, *chain): k", "parts[node] = {(*chain, binder): k"),
        ("two ways to one delta", "merged[chain] = add(merged[chain], k) if chain in merged else k", "merged[chain] = k"),
    ),
    *mutants(
        "teg/analysis/jumps.py",
        ("tests/analysis/test_jumps.py", "tests/passes/lower/test_vanishing.py"),
        ("jump of a product", "before = mul(before, zero(c))", "before = mul(before, one(c))"),
        ("jump of a function", "jumps[node] = sub(at(one, node), at(zero, node))", "jumps[node] = sub(at(zero, node), at(one, node))"),
        ("jump of a condition", "jumps[node] = sub(where(c1, a1, b1), where(c0, a0, b0))", "jumps[node] = where(c1, a1, b1)"),
        (
            "alternatives that stay where a surface is crossed",
            "[negation(v) for v in node.children if v not in contains and not _exclude(c, v)]",
            "[]",
        ),
        ("roots at their edge on a surface", "zeros = {n for n in may_fade if", "zeros = {n for n in may_fade[:0] if"),
        ("where a condition begins to hold", "flips[node] = flips[node.operand][::-1]", "flips[node] = flips[node.operand]"),
        ("jump of a branch", "jumps[node] = where(c1, of(node.then), of(node.otherwise))", "jumps[node] = where(c1, of(node.then), ZERO)"),
    ),
    *mutants(
        "teg/passes/differentiate/forward.py",
        ("tests/passes/differentiate/test_forward.py", *PASSES),
        ("divergence at kinks", "for e in (weight, *velocity.values()) for h", "for e in (weight,) for h"),
        (
            "divergence of a surface's velocity",
            "change = add(_tangents(weight, along)[weight], mul(weight, expansion), *_steps",
            "change = add(_tangents(weight, along)[weight], *_steps",
        ),
        ("speed of a surface", "speed = mul(MINUS_ONE, moving, integer_power(add(", "speed = mul(moving, integer_power(add("),
        (
            "bounds of a surface that moves",
            "rate = sub(tangent_of(bound, along), along.get(b.var, ZERO))",
            "rate = tangent_of(bound, along)",
        ),
    ),
    *mutants(
        "teg/passes/differentiate/forward.py",
        ("tests/analysis/test_singularities.py", "tests/analysis/test_coincidence.py"),
        (
            "rate of a bound beside a singularity",
            "rate = ZERO if (b.var, bound) in field.kept else tangent_of(bound, along)",
            "rate = tangent_of(bound, along)",
        ),
        ("divergence beside a singularity", "*steps, mul(weight, expansion)), chain)]", "*steps), chain)]"),
        ("steps beside a singularity", "nest(add(change, *steps, mul(weight", "nest(add(change, mul(weight"),
        ("other branch of a singular nest", "where(e.condition, ZERO, ex.ONE))))", "where(e.condition, ex.ONE, ZERO))))"),
        ("condition of a singular branch", "(conjunction(condition, negation(e.condition)), e.otherwise)", "(condition, e.otherwise)"),
    ),
    Mutant(
        "surface in another form",
        "teg/passes/differentiate/forward.py",
        "without(change, apart | together)",
        "without(change, apart)",
        ("tests/analysis/test_coincidence.py",),
        "surfaces with the same zeros are one after normalisation; no program is known in which two are left here",
    ),
    *mutants(
        "teg/analysis/kinks.py",
        ("tests/analysis/test_kinks.py",),
        ("sign of an absolute value", "size if sign > 0 else mul(MINUS_ONE, size)", "size"),
    ),
    *mutants(
        "teg/passes/eliminate/implicit.py",
        ("tests/passes/eliminate/test_implicit.py",),
        ("weight of a chart", "integer_power(r, power - 1) if power > 2", "integer_power(r, power) if power > 2"),
    ),
    *mutants(
        "teg/passes/differentiate/reverse.py",
        ("tests/passes/differentiate/test_reverse.py", *PASSES),
        (
            "other branch backwards",
            "(node.otherwise, where(node.condition, ZERO, w)),",
            "(node.otherwise, where(node.condition, w, ZERO)),",
        ),
        ("lower bound backwards", "for bound, sign in ((hi, ONE), (lo, MINUS_ONE)):", "for bound, sign in ((hi, ONE), (lo, ONE)):"),
        (
            "surface of an outer integral",
            "adjoints[p] = add(adjoints.get(p, ZERO), mul(jump, slope, delta(g)))",
            "adjoints[p] = mul(jump, slope, delta(g))",
        ),
        ("product backwards", "return [(child, mul(w, *others))]", "return [(child, w)]"),
        (
            "surface of an integral",
            "integral_over(mul(jump, adjoint, delta(g)), x, lo, hi))))",
            "integral_over(mul(adjoint, delta(g)), x, lo, hi))))",
        ),
    ),
    *mutants(
        "teg/analysis/calculus.py",
        ("tests/passes/differentiate/test_forward.py", "tests/test_derivatives.py", *PASSES),
        (
            "tangent of a branch",
            "return where(node.condition, tangent[node.then], tangent[node.otherwise])",
            "return where(node.condition, tangent[node.then], ZERO)",
        ),
        (
            "tangent of a power",
            "mul(const(node.exponent), t, integer_power(node.base, node.exponent - 1))",
            "mul(t, integer_power(node.base, node.exponent - 1))",
        ),
        ("derivative of cos", 'return [mul(MINUS_ONE, call("sin", u))]', 'return [call("sin", u)]'),
        ("derivative of tan", "return [add(ONE, integer_power(node, 2))]", "return [add(ONE, node)]"),
        ("derivative of sqrt", "return [mul(const(0.5), integer_power(node, -1))]", "return [integer_power(node, -1)]"),
        ("derivative of |u|", "return [where(positive(u), ONE, MINUS_ONE)]", "return [ONE]"),
        ("derivative of atan2", "return [div(x, square), mul(MINUS_ONE, div(u, square))]", "return [div(x, square), div(u, square)]"),
    ),
    *mutants(
        "teg/analysis/surfaces.py",
        ("tests/analysis/test_surfaces.py", *PASSES),
        ("order of tied surfaces", "truth = negation(rising) if comes_first(surface, old.g) else rising", "truth = rising"),
        ("a bound that ties", "truth = TRUE if comes_first(surface, other) else FALSE", "truth = TRUE"),
        ("below an infinite bound", "return TRUE if bound.data > 0 else FALSE", "return FALSE if bound.data > 0 else TRUE"),
        ("order of bounds", "return 1 if lo.data <= hi.data else -1", "return 1"),
        (
            "surfaces that coincide where a rate is 0",
            "return not any(isinstance(rate, Const) and rate is not ZERO for rate in rates)",
            "return False",
        ),
    ),
    *mutants(
        "teg/passes/eliminate/univariate.py",
        ("tests/passes/eliminate/test_families.py", "tests/passes/eliminate/test_univariate.py", *PASSES),
        (
            "weight of a root",
            "value = mul(weight, restrict(coefficient, at, g, directions))",
            "value = restrict(coefficient, at, g, directions)",
        ),
        ("existence of a root", "terms.append(where(root.exists, inside, ZERO))", "terms.append(inside)"),
    ),
    *mutants(
        "teg/passes/eliminate/affine.py",
        ("tests/passes/eliminate/test_vertices.py", "tests/passes/eliminate/test_families.py", *PASSES),
        (
            "weight of a line",
            "value = mul(weight, restrict(coefficient, at, g, directions))",
            "value = restrict(coefficient, at, g, directions)",
        ),
        (
            "weight of a side",
            "value = mul(side.weight, restrict(coefficient, at, g, tuple(at)))",
            "value = restrict(coefficient, at, g, tuple(at))",
        ),
        ("where a line meets the box", "value = where(guard, value, ZERO)", "value = value"),
    ),
    *mutants(
        "teg/passes/normalise/canonicalise.py",
        ("tests/passes/normalise/test_canonicalise.py", *PASSES),
        (
            "sign of a surface's factor",
            "disjunction(conjunction(plus, below), conjunction(minus, above)),",
            "disjunction(conjunction(plus, below), conjunction(minus, below)),",
        ),
    ),
    *mutants(
        "teg/analysis/proportional.py",
        ("tests/passes/normalise/test_canonicalise.py", *PASSES),
        ("sign of a surface's form", "return known, sign > 0", "return known, True"),
    ),
    *mutants(
        "teg/passes/lower/rounding.py",
        (SMALL,),
        ("rounding errors of products", "return total(size(e), *carried)", "return size(e)"),
        ("rounding errors in ties", 'return terms if error == 0.0 else self.out.assign(home, "add", terms, error)', "return terms"),
    ),
    *mutants(
        "backends/numpy/adaptive.py",
        ("tests/backends/numpy/test_kernel.py", SMALL, NUMPY),
        ("bisection", "left[1::2] += width", "left[1::2] += 0.5 * width"),
        (
            "watched signs",
            "changed[part] |= (both > 0.0).any(axis=0) & (both < 0.0).any(axis=0)",
            "changed[part] |= (both > 0.0).any(axis=0)",
        ),
    ),
    *mutants(
        "teg/passes/lower/intervals.py",
        ("tests/passes/lower/test_intervals.py",),
        (
            "roots asked for in the middle only",
            'there += [holds, self.put("ge0", self.out.number(exists.g, self.home))]',
            "there.append(holds)",
        ),
        ("a condition outside of two roots", "Between(atom, roots.found, dead[0] is FALSE)", "Between(atom, roots.found, True)"),
    ),
    *mutants(
        "backends/c/abreast.py",
        ("tests/backends/c/test_abreast.py",),
        ("ties at eight nodes", "<= TEG_TIE_EPS * (", "< 0.0 * ("),
        ("nodes of an interval", "values[{apart * j} + from + k]", "values[{apart * j} + k]"),
        ("large angles", 'f"!teg_near_turns({scope(a)})"', 'f"isnan({scope(a)})"'),
    ),
    Mutant(
        "a leading coefficient that may vanish",
        "teg/passes/lower/intervals.py",
        "isinstance(lead, Const) and isinstance(most",
        "isinstance(most",
        ("tests/passes/lower/test_intervals.py",),
        "roots of such polynomials exist under conditions that are not simple, or are infinite where the coefficient is 0",
    ),
    Mutant(
        "block of lanes",
        "backends/numpy/lanes.py",
        "return max(1, min(self.room // max(1, width), MAX_LANES) // lanes)",
        "return max(1, min(self.room // max(1, width), MAX_LANES) // lanes // 2)",
        (NUMPY,),
        "how many lanes run at a time changes no result",
    ),
    *mutants(
        "backends/shared/rules.py",
        ("tests/numerics/test_quadrature.py", "tests/backends/numpy/test_kernel.py", SMALL, NUMPY),
        ("ties of the second order", "xp.where(order > 0, resolution, xp.logical_not(resolution))", "resolution"),
        ("infinite values tie", "(xp.abs(g) <= TIE_EPS * scale) & xp.isfinite(g)", "(xp.abs(g) <= TIE_EPS * scale)"),
        ("error of Gauss's rule", "0.0, 4.0 * tail * decay)", "0.0, 0.0 * tail * decay)"),
        ("negative powers", "return 1.0 / powi(xp, x, -n)", "return powi(xp, x, -n)"),
    ),
    *mutants(
        "backends/shared/polygons.py",
        ("tests/passes/eliminate/test_vertices.py", "tests/backends/test_polygon.py", SMALL, NUMPY),
        ("start of a segment", "xp.where(begins, xp.maximum(start, root), start)", "start"),
        ("end of a segment", "xp.where(ends, xp.minimum(stop, root), stop)", "stop"),
    ),
    *mutants(
        "backends/shared/ellipses.py",
        ("tests/backends/test_clipped_ellipse.py",),
        ("a disk beyond a line", "self._is_around(u, v, [*sides, *planes])", "self._is_around(u, v, sides)"),
        ("two arcs that go round", "xp.where(around & behind, CIRCLE - apart, apart)", "xp.where(around, CIRCLE - apart, apart)"),
    ),
    *mutants(
        "backends/shared/bends.py",
        SUBSTITUTED,
        ("derivative of a cubic place", "6.0 * t * (1.0 - t)", "6.0 * t"),
        ("derivative of a tail", "1.0 / ((1.0 - t) * (1.0 - t))", "1.0 / (1.0 - t)"),
        ("derivative of a slow tail", "xp.cosh(exponent) / (AT_REACH * left", "xp.cosh(exponent) / (AT_REACH"),
        ("derivative of cosh", "(xp.cosh(t), xp.sinh(t))", "(xp.cosh(t), xp.cosh(t))"),
        ("derivative of a sixth power", "6.0 * (t * t * t * t * t)", "t * t * t * t * t"),
    ),
    *mutants(
        "backends/c/runtime/calls.h",
        (SMALL, C),
        ("ties of the second order in C", "return ctx->order > 0 ? r : !r;", "return r;"),
        ("ties are noted in C", "        ctx->tied = 1;\n        if (ctx->order > 1", "        if (ctx->order > 1"),
    ),
    *mutants(
        "backends/c/batch.py",
        (SMALL, "tests/backends/c/test_lanes.py"),
        (
            "mean of two orders",
            "if (ctx.tied) for (int j = 0; j < {outputs}; j++) row[j] = 0.5 * (row[j] + other[j]);",
            "if (ctx.tied) for (int j = 0; j < {outputs}; j++) row[j] = other[j];",
        ),
        (
            "points that are not live",
            'f"for (int j = 0; j < {self.outputs}; j++) f[{self.apart} * j + k] = 0.0;", "continue;"',
            'f"for (int j = 0; j < {self.outputs}; j++) f[{self.apart} * j + k] = 1.0;", "continue;"',
        ),
        ("points left over", "(k < few ? k : few - 1)", "(k < few ? 0 : 0)"),
        ("simple strides", "simple &= stride[i] == 0 || stride[i] == 1;", "simple &= 1;"),
    ),
    *mutants(
        "backends/jax/runtime.py",
        ("tests/backends/jax/test_kernel.py", JAX),
        ("reversed bounds in JAX", "sign = jnp.where(lo <= hi, 1.0, -1.0)", "sign = 1.0"),
        (
            "Gauss's rule in JAX",
            "sums = half * jnp.sum(weights[:, None] * found, axis=0)",
            "sums = jnp.sum(weights[:, None] * found, axis=0)",
        ),
        ("sorted breaks in JAX", "points = jnp.sort(points)", "points = points"),
    ),
    *mutants(
        "backends/jax/roots.py",
        ("tests/backends/jax/test_isolate.py", "tests/backends/jax/test_kernel.py", JAX),
        (
            "points of a sum in JAX",
            "found = [jnp.where(when, jnp.where(refused, jnp.nan, v), jnp.inf)",
            "found = [jnp.where(when, jnp.where(refused, jnp.nan, v), 0.0)",
        ),
    ),
    *mutants(
        "backends/numpy/polygon.py",
        ("tests/passes/eliminate/test_vertices.py", "tests/backends/test_polygon.py", SMALL, NUMPY),
        (
            "ties of a segment",
            "found[i] = ties, resolution if run.order > 0 else np.logical_not(resolution)",
            "found[i] = ties, resolution",
        ),
    ),
    *mutants(
        "teg/passes/normalise/tables.py",
        ("tests/passes/normalise/test_tables.py",),
        ("origin of a table", "mul(entry(rate), sub(leaf, entry(origin)))", "mul(entry(rate), leaf)"),
        ("columns of a table", "if key not in self._columns:", "if not self._columns:"),
    ),
    *mutants(
        "teg/passes/differentiate/through_sums.py",
        ("tests/passes/normalise/test_tables.py",),
        ("what is collected", "Collected.make((table.index, column), (derivative,))", "Collected.make((table.index, 1), (derivative,))"),
    ),
    *mutants(
        "teg/passes/lower/linear.py",
        ("tests/passes/normalise/test_tables.py",),
        ("sums of an earlier stage", "if stage[node] < stage[e] else []", "if False else []"),
    ),
    *mutants(
        "backends/c/runtime/calls.h",
        ("tests/passes/normalise/test_tables.py", "tests/backends/c/test_queues.py"),
        ("rows that are listed", "if ((uint64_t)entries[k] < (uint64_t)rows) listed[entries[k]] = 1;", "listed[0] = 1;"),
        ("copies are cleared", "into[i] += copy[i], copy[i] = 0.0;", "into[i] += copy[i];"),
        ("marks of the second copy", "copy += size, marks += blocks;", "copy += size;"),
    ),
    *mutants(
        "backends/numpy/cells.py",
        ("tests/passes/normalise/test_tables.py",),
        ("a candidate that is not there", "np.where((moving != 0.0) & (slopes != 0.0), moving", "np.where(moving != 0.0, moving"),
    ),
    *mutants(
        "teg/analysis/projection.py",
        ("tests/analysis/test_breaks.py",),
        ("a line that is level", "        if degree != 0 and (apart or not self.finite):", "        if degree != 0 and not self.finite:"),
        ("what may be level", "return all(one[m] != c for m, c in other.items() if m in one)", "return False"),
        ("surfaces that do not meet", "        if len(both) > max(len(a), len(b)) + 1:", "        if len(both) > max(len(a), len(b)) + 2:"),
        ("surfaces that meet", "        if len(both) > max(len(a), len(b)) + 1:", "        if len(both) > max(len(a), len(b)):"),
        ("both bounds of a variable", "        if len({k.var for k in bounds}) < len(bounds):", "        if False:"),
    ),
    *mutants(
        "teg/analysis/breaks.py",
        ("tests/analysis/test_breaks.py",),
        ("products of integrals", "if _is_linear_in_integrals(body) else {}", "if True else {}"),
        ("how many are isolated", "if len(functions) <= MAX_ISOLATED else", "if True else"),
    ),
    *mutants(
        "teg/passes/normalise/regions.py",
        ("tests/passes/normalise/test_regions.py",),
        ("the larger operand", "conditions.append(side if (i < j) == largest else negation(side))", "conditions.append(side)"),
        ("one plane, two names", "return positive(plane) if same else negation(positive(plane))", "return positive(plane)"),
        ("a region that is empty", "        if both is FALSE:\n", "        if False:\n"),
        ("surfaces of a higher degree", "if any(d is None or d > MOST_DEGREE for d in degrees):", "if False:"),
        ("how many regions", "if len(done) + len(waiting) > MOST_REGIONS:", "if False:"),
        ("the rest of a condition", "rest, ones, all_sides, side = FALSE,", "rest, ones, all_sides, side = TRUE,"),
    ),
    *mutants(
        "teg/analysis/births.py",
        ("tests/end_to_end/test_conics.py",),
        ("a critical point that is nowhere", "if any(_is_nowhere(e) for e in point.values()):", "if False:"),
    ),
    *mutants(
        "teg/passes/intrinsics/ellipse/match.py",
        ("tests/end_to_end/test_conics.py",),
        ("no ellipse", "if is_null(whole) or _is_flat((a, b, c, d)):", "if whole is ZERO:"),
    ),
    *mutants(
        "teg/passes/intrinsics/ellipse/errors.py",
        ("tests/end_to_end/test_conics.py",),
        ("a place without digits", 'far = errors.op(out, "max", STEP, errors.op(out, "mul", BEYOND, relative))', "far = STEP"),
    ),
    *mutants(
        "teg/passes/lower/guarded.py",
        ("tests/end_to_end/test_infinite_ranges.py",),
        (
            "a break outside",
            "place = _within(point.then if isinstance(point, Where) else point, inner)",
            "place = point.then if isinstance(point, Where) else point",
        ),
    ),
    *mutants(
        "teg/ir/simplify.py",
        ("tests/ir/test_expr.py",),
        ("a multiple of a branch", "times = [(const(c), w)", "times = [(ONE, w)"),
    ),
    *mutants(
        "teg/pipeline.py",
        ("tests/passes/eliminate/test_charts.py",),
        ("the name of a chart's variable", "return cast(Expr, rename_apart(e, clashing)) if clashing else e", "return e"),
    ),
    *IN_ANALYSES,
    *IN_PASSES,
    *IN_BACKENDS,
)
