"""Single wrong changes of passes."""

from __future__ import annotations

from tests.mutation.mutant import Mutant, mutants

SPHERES = ("tests/end_to_end/test_spheres.py",)
ADJOINTS = "tests/passes/intrinsics/test_adjoints.py"

IN_PASSES: tuple[Mutant, ...] = (
    *mutants(
        "teg/passes/eliminate/univariate.py",
        ("tests/passes/eliminate/test_univariate.py",),
        (
            "the rate of a quadratic at its root",
            'call("magnitude", rate_there) if root.rate is None else root.rate',
            'call("magnitude", rate_there)',
        ),
    ),
    *mutants(
        "teg/passes/normalise/angles.py",
        ("tests/passes/normalise/test_angles.py",),
        ("an angle measured clockwise", "return mul(MINUS_ONE, v) if clockwise else v, u, add(*rest)", "return v, u, add(*rest)"),
        ("the radius of another angle", "and not is_null(sub(radius.children[0], square))", "and False"),
    ),
    *mutants(
        "teg/passes/lower/vanishing.py",
        ("tests/passes/lower/test_vanishing.py",),
        ("a logarithm at its border", "return next((f for f in e.children if _base(f) in sums), None)", "return None"),
    ),
    *mutants(
        "teg/passes/normalise/canonicalise.py",
        ("tests/passes/normalise/test_canonicalise.py",),
        ("a kink without a formula", "not _has_formula(b.condition.g) and kinks.sign(b)", "False"),
        ("a function less than itself", "if all(p.value(g) == 0 for p in self._points):  # rounding", "if False:  # rounding"),
    ),
    *mutants(
        "teg/passes/normalise/denominators.py",
        ("tests/passes/normalise/test_canonicalise.py",),
        (
            "the square of a secant",
            "if isinstance(node, Add) and (u := _angle_of_secant(node)) is not None:",
            "if (u := None) is not None:",
        ),
    ),
    *mutants(
        "teg/passes/normalise/bounded_choices.py",
        ("tests/passes/normalise/test_bounded_choices.py",),
        ("the least or the largest", "(number.data > 0.0) == (choice.value is choice.key)", "choice.value is choice.key"),
        (
            "the least of none",
            "conjunction(decided, some) if rises else disjunction(decided, negation(some))",
            "conjunction(decided, some)",
        ),
    ),
    *mutants(
        "teg/passes/lower/roots.py",
        ("tests/passes/lower/test_roots.py",),
        ("the cut of an angle as a root", 'out.assign(level, "select", jumps, 0.0, v)', "v"),
    ),
    *mutants(
        "teg/passes/lower/pieces.py",
        ("tests/passes/lower/test_pieces.py",),
        ("the width of a double root", "where(_is_unresolved(c.place, c.width), ZERO, c.width)", "c.width"),
    ),
    *mutants(
        "teg/passes/differentiate/moving_poles.py",
        ("tests/passes/differentiate/test_moving_poles.py",),
        ("a least value that is no pole", "return pole if is_null(g) else None", "return pole"),
        ("bounds of the distance from a pole", "tidy(sub(b, place)) for b", "tidy(add(b, place)) for b"),
        ("places of poles", "return {self._keys.of(sub(x, pole[x])): pole", "return {self._keys.of(pole[x]): pole"),
        ("parts outside of a range", "between(mul(const(0.5), add(p, q)), node.lo, node.hi)", "mul(const(0.5), add(p, q))"),
        ("poles of one product", "if len(poles) > MAX_POLES or", "if len(poles) > 1 or"),
        ("where an exponential ceases to decay", "if is_null(cast(Expr, substitute(rate", "if not is_null(cast(Expr, substitute(rate"),
    ),
    *mutants(
        "teg/passes/normalise/factors.py",
        ("tests/passes/normalise/test_radicals.py",),
        ("denominators without a sign", "not e.free and (e.exponent % 2 == 0 or", "not e.free and (True or"),
    ),
    *mutants(
        "teg/passes/normalise/radicals.py",
        ("tests/passes/normalise/test_radicals.py",),
        ("where a root ends", "return conjunction(ends, disjunction(", "return conjunction(disjunction("),
        ("a root that is subtracted", "conjunction(negation(rising), less, above)", "conjunction(negation(rising), less)"),
        ("a root that is added", "disjunction(more, above)", "more"),
        ("square of the difference of roots", "add(difference, square), strict, TRUE", "sub(difference, square), strict, TRUE"),
    ),
    Mutant(
        "sign of a root in a short piece",
        "teg/passes/lower/emit.py",
        '"mul", TIE_EPS, self.rounding.terms_size(u, middle)',
        '"mul", 0.0, self.rounding.terms_size(u, middle)',
        SPHERES,
    ),
    Mutant(
        "a curve that is a line",
        "teg/passes/differentiate/missed_cuts.py",
        "for c in factors_beside_squares(g):",
        "for c in factors_beside_squares(g)[:0]:",
        SPHERES,
    ),
    Mutant(
        "kinks of an angle",
        "teg/passes/normalise/cuts.py",
        "_written_in_half_planes(node) if lines is None",
        "None if lines is None",
        SPHERES,
    ),
    *mutants(
        "teg/passes/normalise/cuts.py",
        ("tests/passes/normalise/test_cuts.py",),
        ("a quotient with a common factor", "p, q = _reduced(*cleared(argument))", "p, q = cleared(argument)"),
        ("angles upwards", "    if _is_zero(u):\n", "    if False:\n"),
        ("angles along an axis", "    if _is_zero(v):\n", "    if False:\n"),
        ("an angle less than itself", "_less(v, u, t, not condition.strict)", "_less(v, u, t, condition.strict)"),
    ),
    *mutants(
        "teg/passes/eliminate/affine.py",
        ("tests/passes/eliminate/test_families.py",),
        ("bounds of a pivot that turns", "(*others, *along) if turning else (*along, *others)", "(*along, *others)"),
    ),
    *mutants(
        "teg/passes/eliminate/families.py",
        ("tests/passes/eliminate/test_families.py",),
        ("conditions of a factor", "return where(guard, mul(*outside), ZERO), where(", "return mul(*outside), where("),
    ),
    *mutants(
        "teg/passes/lower/vanishing.py",
        ("tests/passes/lower/test_vanishing.py",),
        ("factors that are the whole product", "if 0 < len(small) < len(e.children) and", "if small and"),
    ),
    *mutants(
        "teg/passes/normalise/centre.py",
        ("tests/passes/normalise/test_centre.py",),
        ("distances from the sides", "return add(add(centre, *outside), distance,", "return add(add(distance, centre), *outside,"),
        ("a root that is an edge", "if known is not None:", "if False:"),
        ("the roots of a condition", "            return h\n    return g", "            return g\n    return g"),
    ),
    *mutants(
        "teg/passes/lower/changes.py",
        ("tests/passes/lower/test_changes.py", "tests/end_to_end/test_moving_powers.py"),
        ("the range of what changes inside", "self.boxed), sub(high, low), rate)", "self.boxed), rate)"),
        (
            "the rate of a change",
            'return reduce(lambda a, b: call("max", a, b), sizes(',
            "return const(1.0) if rates else reduce(max, sizes(",
        ),
        ("bounds of integrable singularities", "if not -1.0 < exponent < 0.0 or g.has_integral:", "if True:"),
        ("a slope is a size", "if not (isinstance(node, Pow) or (isinstance(node, Call) and node.name in SIZES)):", "if False:"),
        ("a power beside its logarithm", "n.children[0] is base for n", "n.children[0] is node for n"),
    ),
    *mutants(
        "teg/passes/lower/pieces.py",
        ("tests/passes/lower/test_gaussian.py",),
        ("the end of a tail", "sub(node.var, div(const(DECAY), slope_there))", "add(node.var, div(const(DECAY), slope_there))"),
        ("tails beside surfaces", "self._tails(group, (lo, hi, *surfaces), home)", "self._tails(group, (lo, hi), home)"),
    ),
    *mutants(
        "teg/passes/lower/pieces.py",
        ("tests/passes/lower/test_pieces.py",),
        ("the part of a line where a Gaussian counts", "is_bell = is_unbounded(group[0]) and", "is_bell = False and"),
    ),
    *mutants(
        "teg/passes/normalise/quotients.py",
        ("tests/passes/normalise/test_quotients.py",),
        ("factors of a branch", "mul(*others, kink.otherwise))", "kink.otherwise)"),
    ),
    *mutants(
        "teg/passes/normalise/runs.py",
        ("tests/passes/normalise/test_runs.py",),
        ("the last run", 'index_call("sub", cast(Index, Length.make((runs.starts, 0), ())), index_const(1))', "index_const(1)"),
        ("entries that are no runs", "        if _entry(g, old.index) in entries\n", "        if _entry(g, old.index) is not None\n"),
    ),
    *mutants(
        "teg/passes/normalise/partitions.py",
        ("tests/passes/normalise/test_partitions.py",),
        ("a guard that is negated", "g = mul(MINUS_ONE, compare.g) if negated else compare.g", "g = compare.g"),
        ("coefficients of Taylor", "const(1.0 / (math.factorial(i) * math.factorial(j)))", "ONE"),
        ("guards left over", "numbers += [ONE, ZERO, ZERO] * (guards", "numbers += [MINUS_ONE, ZERO, ZERO] * (guards"),
    ),
    *mutants(
        "teg/passes/normalise/finite_bounds.py",
        ("tests/passes/eliminate/test_endless.py::test_a_plane_shares_the_finite_coordinates_of_another_surface",),
        ("surfaces in new variables", "and not mapped.isdisjoint(mine)]", "and False]"),
    ),
    *mutants(
        "teg/passes/differentiate/missed_cuts.py",
        ("tests/passes/differentiate/test_missed_cuts.py",),
        ("side of a cut", "positive(mul(MINUS_ONE, left)))", "positive(left))"),
        ("second derivatives at a cut", "if (again or m.moves) and", "if m.moves and"),
        ("surfaces that end on a cut", "moves = isinstance(node, Delta) or", "moves ="),
        ("ranges that are not known", "        return TRUE\n    return conjunction(", "        return FALSE\n    return conjunction("),
    ),
    *mutants(
        "teg/passes/eliminate/implicit.py",
        ("tests/passes/eliminate/test_implicit.py",),
        ("inside of moving bounds", "inside = signed_inside(b.var, b.lo, b.hi, g, b, inside)", "pass"),
        ("a surface at its birth", "return add(g, where(critical.inside, sub(moved, critical.value), ZERO))", "return g"),
    ),
    *mutants(
        "teg/passes/eliminate/implicit.py",
        ("tests/passes/eliminate/test_charts.py",),
        ("lengths of a long ellipse", "extents = _extents(slopes, boxes)", "extents = [sub(b.hi, b.lo) for b in boxes]"),
    ),
    *mutants(
        "teg/passes/normalise/partitions.py",
        ("tests/passes/normalise/test_partitions.py",),
        ("a row of zeros", "return [add(c, const(-NOTHING)), a, b]", "return [c, a, b]"),
    ),
    *mutants(
        "teg/passes/lower/roots.py",
        ("tests/analysis/test_breaks.py",),
        (
            "boxes across a region's border",
            'outside, NAN, self.out.assign(at_both, "select", across, known, bound))',
            "outside, NAN, bound)",
        ),
    ),
    Mutant(
        "derivatives of a density as one term",
        "teg/passes/lower/gaussian.py",
        "plain = tidy(e, scale)",
        "plain = e",
        ("tests/passes/lower/test_gaussian.py",),
    ),
    *mutants(
        "teg/passes/lower/gaussian.py",
        ("tests/passes/lower/test_gaussian.py",),
        ("moments of a high degree", "MOST_DEGREE = 16", "MOST_DEGREE = 8"),
        ("short pieces of high moments", "(degree > CUBIC) + (degree > HIGH)", "0"),
        ("signs that roots tell", "if e in known:", "if False:"),
        ("powers of sums that are small", "(plain is not e and _terms(plain) < _terms(local))", "plain is not e"),
        ("tails of high moments", "RISE * max(0, degree - CUBIC)", "0.0"),
    ),
    Mutant(
        "ends of a layer on a curve",
        "teg/passes/lower/pieces.py",
        "for place in (node.var, sub(node.var, width), add(node.var, width)):",
        "for place in (node.var,):",
        ("tests/passes/lower/test_gaussian.py",),
    ),
    Mutant(
        "an angle beside its argument",
        "teg/passes/normalise/cuts.py",
        "if flat is None or flat.free else",
        "if True else",
        ("tests/passes/normalise/test_cuts.py",),
    ),
    Mutant(
        "terms of one exponential in sums of sums",
        "teg/passes/lower/means.py",
        "if not isinstance(moving[0], Add):",
        "if True:",
        ("tests/passes/lower/test_gaussian.py",),
    ),
    Mutant(
        "a bell that is nowhere",
        "teg/passes/lower/pieces.py",
        'self.out.assign(home, "ok", self.out.assign(home, "sub", at, at)), at, NAN)',
        'self.out.assign(home, "ok", at), at, NAN)',
        ("tests/passes/lower/test_gaussian.py",),
    ),
    *mutants(
        "teg/passes/eliminate/conic.py",
        ("tests/passes/eliminate/test_conic.py",),
        (
            "an ellipse much larger than its box",
            "return None if charts is None else where(fits, quarters, charts)",
            "return quarters",
        ),
        ("bases along an ellipse", "symbols.get(node)", "None"),
    ),
    *mutants(
        "teg/passes/eliminate/matrix.py",
        ("tests/passes/eliminate/test_matrix.py",),
        ("a matrix that is not definite", "conjunction(definite, is_near", "conjunction(is_near"),
        ("a matrix of zeros", "disjunction(negation(curved), conjunction", "disjunction(conjunction"),
    ),
    *mutants(
        "teg/passes/intrinsics/pole/match.py",
        ("tests/backends/test_poles.py",),
        ("zero of a denominator", "at = divided(-linear.get((0,), 0), linear[1,])", "at = divided(linear.get((0,), 0), linear[1,])"),
    ),
    *mutants(
        "teg/passes/intrinsics/hyperbola/lowering.py",
        ("tests/backends/test_hyperbola.py",),
        ("area of a box", 'total if area == 1.0 or not mine else self.out.assign(home, "mul", total, area)', "total"),
    ),
    *mutants(
        "teg/passes/intrinsics/ellipse/match.py",
        ("tests/backends/test_ellipse.py",),
        ("a long ellipse", "return not (a is d and b is c is ZERO)", "return False"),
    ),
    *mutants(
        "teg/passes/intrinsics/ellipse/match.py",
        ("tests/backends/test_intrinsics.py",),
        ("inside of an ellipse", "*((above, below) if curve.sign > 0.0 else (below, above)))", "*(above, below))"),
    ),
    *mutants(
        "teg/passes/intrinsics/polygon/adjoints.py",
        (ADJOINTS,),
        ("factor of a moment", "new = self.steady.mul(c, factor)", "new = c"),
    ),
    *mutants(
        "teg/passes/intrinsics/polygon/polynomials.py",
        (ADJOINTS,),
        ("power of a derivative", "(a + k * b) % P for a, b in zip(given", "(a + b) % P for a, b in zip(given"),
    ),
    *mutants(
        "teg/passes/intrinsics/polygon/lowering.py",
        ("tests/backends/test_polyhedron.py",),
        ("half-planes that tie", '"select", ties, known, n)', '"select", ties, n, known)'),
    ),
    *mutants(
        "teg/passes/intrinsics/polygon/errors.py",
        ("tests/backends/test_polyhedron.py",),
        ("corners that stay", 'off.append(errors.op(out, "mul", CLIP_EPS, errors.sum_of(terms, out)))', "pass"),
    ),
    *mutants(
        "teg/passes/differentiate/edges.py",
        ("tests/passes/differentiate/test_edges.py", "tests/passes/differentiate/test_layers.py"),
        ("edges from opposite sides", "disjunction(covering(MINUS_ONE), wider, *nothing)", "disjunction(wider, *nothing)"),
        ("the first of equal edges", "conjunction(covering(ONE), less(distance, ZERO, True))", "FALSE"),
        ("two edges of a candidate on one line", "wider, *nothing)", "wider)"),
        ("a line beyond the box", "BEYOND = 0.0291", "BEYOND = 0.0"),
        ("quarters of an arc", "index_const(4))", "index_const(3))"),
    ),
    *mutants(
        "teg/passes/normalise/uncovered.py",
        ("tests/passes/differentiate/test_layers.py", "tests/passes/differentiate/test_edges.py"),
        ("keys that are the same function", "where(before, ONE, MINUS_ONE)", "ONE"),
        ("rows of zeros", "-NO_FORM if new.strict else NO_FORM", "NO_FORM if new.strict else -NO_FORM"),
        ("places where nothing is", "where(positive(sub(free, mul(const(NO_AREA), box))), NOTHING, ZERO)", "ZERO"),
    ),
    *mutants(
        "teg/passes/lower/gaps.py",
        ("tests/passes/differentiate/test_layers.py",),
        (
            "edges of which nothing is seen",
            'self.out.assign(self.top, "max", found, self.out',
            'self.out.assign(self.top, "min", found, self.out',
        ),
    ),
    *mutants(
        "teg/passes/lower/gaps.py",
        ("tests/passes/differentiate/test_moving_ends.py",),
        ("velocities in the order of places", 'others[i : i + 2] = out.assign(top, "select", swapped, v, u)', "others[i : i + 2] = u"),
    ),
    *mutants(
        "teg/passes/differentiate/gaps.py",
        ("tests/passes/differentiate/test_moving_ends.py",),
        ("ends that move", "mul(MINUS_ONE, rate(g, {})", "mul(ONE, rate(g, {})"),
    ),
    *mutants(
        "teg/passes/differentiate/edges.py",
        ("tests/passes/differentiate/test_moving_ends.py",),
        (
            "a side of a box beside edges",
            "terms = [with_gaps(integral_over(rest, node.var, node.lo, node.hi), derive)]",
            "terms = [integral_over(rest, node.var, node.lo, node.hi)]",
        ),
    ),
    *mutants(
        "teg/passes/lower/linear.py",
        ("tests/passes/differentiate/test_moving_ends.py",),
        ("terms that do not count", "where(condition, w, ZERO)) for condition, weights", "w) for condition, weights"),
    ),
    *mutants(
        "teg/passes/differentiate/through_sums.py",
        ("tests/passes/differentiate/test_moving_ends.py",),
        ("a candidate beside itself", "where(condition, rate(add(*terms), changes), ZERO) for", "rate(add(*terms), changes) for"),
    ),
    *mutants(
        "teg/evaluator/plan.py",
        ("tests/passes/differentiate/test_moving_ends.py",),
        ("what does not move in a first derivative", "tangent(released(slope), direction", "tangent(slope, direction"),
    ),
    *mutants(
        "teg/analysis/gates.py",
        ("tests/analysis/test_gates.py",),
        ("alternatives as gates", "(negation(c) for c in others)", "(c for c in others)"),
    ),
)
