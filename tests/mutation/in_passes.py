"""Single wrong changes of analyses, passes and numbers."""

from __future__ import annotations

from tests.mutation.mutant import Mutant, mutants

STEPS = "tests/passes/normalise/test_steps.py"
GUARDED = "tests/passes/lower/test_guarded.py"
QUADRATURE = "tests/numerics/test_quadrature.py"
SPHERES = ("tests/end_to_end/test_spheres.py",)
ADJOINTS = "tests/passes/intrinsics/test_adjoints.py"

IN_PASSES: tuple[Mutant, ...] = (
    *mutants(
        "teg/analysis/roots.py",
        ("tests/analysis/test_roots.py", "tests/passes/eliminate/test_univariate.py", "tests/passes/eliminate/test_endless.py"),
        ("a discriminant as a product", "return mul(const(-4), a, c)", "pass"),
        ("a line that is everywhere", "met if met is TRUE or level.free else disjunction(met, negation(_not_zero(level)))", "met"),
    ),
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
        "teg/analysis/breaks.py",
        ("tests/analysis/test_breaks.py",),
        ("zeros of factors", "dict.fromkeys(factor for branch in branches for factor in _factors(branch, x))", "branches"),
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
        "backends/shared/roots.py",
        ("tests/analysis/test_breaks.py",),
        ("boxes in which rounding decides the sign", "bent_up, noise = bounds\n", "bent_up, noise = (*bounds[:6], 0.0)\n"),
    ),
    *mutants(
        "teg/ir/simplify.py",
        ("tests/ir/test_simplify.py", "tests/passes/eliminate/test_implicit.py"),
        (
            "a branch that is 0 where a condition holds",
            "if isinstance(e, Where) and e.then is ZERO:\n        return neg",
            "if False:\n        return neg",
        ),
    ),
    *mutants(
        "teg/passes/normalise/canonicalise.py",
        ("tests/passes/normalise/test_canonicalise.py",),
        ("a kink without a formula", "not _has_formula(b.condition.g) and kinks.sign(b)", "False"),
        ("a function less than itself", "if all(p.value(g) == 0 for p in self._points):  # rounding", "if False:  # rounding"),
    ),
    *mutants(
        "teg/analysis/polynomial.py",
        ("tests/analysis/test_polynomial.py", "tests/passes/normalise/test_canonicalise.py"),
        ("the size of a negative number", "least = min(value % P, -value % P)", "least = value % P"),
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
        "teg/numerics/arrangement.py",
        ("tests/backends/numpy/test_cells.py",),
        ("keys at a corner of the square", "2 if equal + _sides_at((x, y)) > 4 else 1", "1"),
        ("keys that are taken apart", "self.nudge = nudge * NUDGE", "self.nudge = abs(nudge) * NUDGE"),
    ),
    *mutants(
        "teg/analysis/staircase.py",
        ("tests/passes/normalise/test_cuts.py",),
        (
            "steps of an angle at known places",
            "return add(fixed, const(-most)), add(fixed, const(most)), const(2.0 * most)",
            "return extent",
        ),
    ),
    *mutants(
        "teg/analysis/twins.py",
        ("tests/analysis/test_twins.py",),
        ("a surface that stands across", "positive(factor, True, TRUE, rivals), positive(side)", "positive(factor), positive(side)"),
        ("falling surfaces", "conjunction(negation(rising), negation(beyond))", "negation(rising)"),
        ("one rate of several that are 0", "where(positive(size, True, TRUE, rivals), ONE, MINUS_ONE)", "ONE"),
        ("differences that cancel", "if (cancelled := expanded(difference)) is not None", "if (cancelled := None) is not None"),
    ),
    *mutants(
        "teg/analysis/surfaces.py",
        ("tests/analysis/test_twins.py",),
        ("the same variable inside and outside", "e = cast(Expr, rename_apart(e, common))", "pass"),
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
        "teg/ir/simplify.py",
        ("tests/ir/test_simplify.py",),
        ("powers of quotients", "if any([k * powers[product] * powers.get(base, 0) < 0", "if any([0 < 0"),
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
        "teg/analysis/implied.py",
        ("tests/analysis/test_implied.py",),
        ("a square on its surface", "return FALSE if sign == square.sign else TRUE", "return TRUE if sign == square.sign else FALSE"),
        ("a square on what it was made of", "return TRUE if square.sign > 0 else FALSE", "return FALSE if square.sign > 0 else TRUE"),
        ("scale of a square", 'call("sqrt", div(square.scale, c))', 'call("sqrt", div(ONE, c))'),
        ("the other root's square", "add(v, mul(const(0.5), c))", "add(v, mul(const(0.25), c))"),
    ),
    *mutants(
        "teg/analysis/powers.py",
        ("tests/analysis/test_powers.py", "tests/end_to_end/test_moving_powers.py"),
        ("exponents that are too small", "LEAST = 1.5", "LEAST = -0.5"),
        ("products of powers", "return mul(*rest, *(", "return mul(*("),
    ),
    *mutants(
        "teg/analysis/roots.py",
        ("tests/analysis/test_roots.py",),
        ("zeros of a wave in an interval", "/ math.pi) + 3", "/ math.pi)"),
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
        "conditions on functions that may be no numbers",
        "teg/ir/integral.py",
        "outer = [c for c in outer if not _asks_partial_functions(c)]",
        "outer = [c for c in outer if c]",
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
        "teg/analysis/roots.py",
        ("tests/analysis/test_roots.py",),
        ("an angle beyond a half turn", "exists = conjunction(_within(c, -math.pi, math.pi), positive(", "exists = conjunction(positive("),
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
        "teg/analysis/projection.py",
        ("tests/analysis/test_projection.py",),
        ("a surface at a fixed bound", "fixed = self._fixed()", "fixed: dict[Expr, Expr] = {}"),
        ("the wider range of point masses", "if self.surface is None:\n            for bound", "if not apart:\n            for bound"),
    ),
    *mutants(
        "teg/passes/lower/vanishing.py",
        ("tests/passes/lower/test_vanishing.py",),
        ("factors that are the whole product", "if 0 < len(small) < len(e.children) and", "if small and"),
    ),
    *mutants(
        "teg/analysis/staircase.py",
        (STEPS,),
        ("last step of a staircase", "last = math.ceil(highest) - 1 if", "last = math.ceil(highest) - 2 if"),
        (
            "halves go to the even side",
            "where(disjunction(positive(over), conjunction(positive(over, strict=False), odd)), add",
            "where(positive(over, strict=False), add",
        ),
        ("more steps than are counted", "guard = positive(sub(add(base, const(float(count))), most))", "guard = TRUE"),
        ("size of a sum", "size = math.fsum(parts)", "size = max(parts)"),
        ("a variable that cancels in steps", "g = expanded(c.g) if c.g.free else c.g", "g = c.g"),
    ),
    *mutants(
        "teg/analysis/sharp.py",
        (GUARDED,),
        (
            "extent of an inner integral",
            "return mul(sub(high, low), size_of(node.body, Enclosure({**box, node.var: (low, high)})))",
            "return ZERO",
        ),
        ("narrow functions that are tame", "<= math.log(UNSEEN)", "<= 1e9 * math.log(UNSEEN)"),
        ("steps that are narrow", 'case "tanh":', 'case "no tanh":'),
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
        "teg/analysis/centres.py",
        ("tests/passes/lower/test_gaussian.py",),
        ("tails from outside", "for edge in edges if c.high else ():", "for edge in ():"),
        ("a Gaussian of at most 1", "return not (is_null(exponent) or", "return not (False or"),
    ),
    *mutants(
        "teg/analysis/beside.py",
        ("tests/analysis/test_beside.py",),
        ("the side of a condition", "TRUE if known[n.g] * side > 0.0 else FALSE", "TRUE if side > 0.0 else FALSE"),
        ("what is 0 on a surface", "return ZERO if n in null else None", "return None"),
    ),
    *mutants(
        "teg/analysis/intervals.py",
        ("tests/analysis/test_intervals.py",),
        ("a power by its logarithm", "where(turns, div(const(-1.0 / math.e), k), _least(*ends))", "_least(*ends)"),
        ("a negative power by a logarithm", "known = conjunction(positive(k), positive(u[1]))", "known = positive(u[1])"),
    ),
    *mutants(
        "teg/analysis/endless.py",
        (GUARDED, "tests/end_to_end/test_infinite_ranges.py"),
        (
            "bound of a function that falls",
            "hi = where(self.endless_right, where(falls, at_left, natural[1])",
            "hi = where(self.endless_right, where(rises, at_left, natural[1])",
        ),
    ),
    *mutants(
        "teg/analysis/limits.py",
        ("tests/analysis/test_limits.py",),
        (
            "denominator of a limit",
            "return mul(*others, numerator, integer_power(denominator, -1)) if n else node",
            "return mul(*others, numerator) if n else node",
        ),
        ("order of a zero", "                return n, e\n", "                return 1, e\n"),
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
        "teg/analysis/projection.py",
        ("tests/end_to_end/test_spheres.py",),
        (
            "a line in which a variable cancels",
            "self._put(cast(Expr, substitute(f, {z: self.origin})))\n        else:",
            "self._put(f)\n        else:",
        ),
    ),
    *mutants(
        "teg/analysis/breaks.py",
        ("tests/analysis/test_breaks.py",),
        ("roots beside poles", "i.inside(region) if has_pole(f, x) else i", "i"),
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
        "densities that a surface divides",
        "teg/analysis/centres.py",
        "surfaces if narrow else ()",
        "()",
        ("tests/passes/lower/test_gaussian.py",),
    ),
    Mutant(
        "derivatives of a density as one term",
        "teg/passes/lower/gaussian.py",
        "if is_null(whole):",
        "if False:",
        ("tests/passes/lower/test_gaussian.py",),
    ),
    Mutant(
        "exponentials between edges that meet",
        "teg/analysis/centres.py",
        'for edge in edges if c.kind == "decay" else ():',
        "for edge in ():",
        ("tests/passes/lower/test_gaussian.py",),
    ),
    Mutant(
        "a bell that is nowhere",
        "teg/passes/lower/pieces.py",
        'self.out.assign(home, "ok", self.out.assign(home, "sub", at, at)), at, NAN)',
        'self.out.assign(home, "ok", at), at, NAN)',
        ("tests/passes/lower/test_gaussian.py",),
    ),
    Mutant(
        "discriminants of squares",
        "teg/analysis/roots.py",
        "return plain if by_squares is None or",
        "return plain if True or",
        ("tests/analysis/test_squares.py",),
    ),
    *mutants(
        "teg/passes/eliminate/conic.py",
        ("tests/passes/eliminate/test_conic.py",),
        (
            "an ellipse much larger than its box",
            "return None if charts is None else where(_fits(curve, boxes), quarters, charts)",
            "return quarters",
        ),
        ("bases along an ellipse", "symbols.get(node)", "None"),
    ),
    *mutants(
        "teg/analysis/critical.py",
        ("tests/passes/eliminate/test_charts.py", "tests/passes/eliminate/test_implicit.py", "tests/passes/eliminate/test_conic.py"),
        ("centres of squares", "split is not None and len(split[0])", "split is None and len(split[0])"),
        ("least height of a long ellipse", "mul(const(APART), critical.terms), mul", "mul(const(APART), critical.size), mul"),
        ("lengths beside a place", "mul(const(0.5 * APART), call", "mul(const(0.5), call"),
        ("least height of a birth", "add(least_height(critical), where", "add(ZERO, where"),
        ("least height of a crossing", "mul(const(APART), critical.size), ZERO)", "ZERO, ZERO)"),
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
        "teg/numerics/moments.py",
        ("tests/numerics/test_moments.py",),
        ("sign of an odd moment", "tuple(-a for a in moment(k, 0)) if k % 2 else moment(k, 0)", "moment(k, 0)"),
    ),
    *mutants(
        "teg/numerics/quadrature.py",
        (QUADRATURE, "tests/backends/test_poles.py"),
        ("norm of a null rule", "norm = math.sqrt(degree + 0.5)", "norm = 1.0"),
        ("series of a pole", "math.comb(power - 1 + i, i) * 2.0", "2.0"),
    ),
    *mutants(
        "teg/numerics/measured.py",
        ("tests/numerics/test_cell_integrals.py", "tests/backends/numpy/test_cells.py", "tests/backends/c/test_cells.py"),
        ("a line that turns", "stretch -= line.unit[1] * turning[1] + line.unit[2] * turning[2]", "pass"),
        ("an area that grows", "growth = 0.5 * (e * d + a * h - g * b - c * f)", "growth = 0.5 * (e * d + a * h)"),
    ),
    *mutants(
        "teg/numerics/key_edges.py",
        ("tests/numerics/test_key_edges.py",),
        ("the key that is less beyond", "slope > steepest + arrangement.flat", "slope < steepest + arrangement.flat"),
    ),
    *mutants(
        "teg/analysis/decay.py",
        ("tests/analysis/test_decay.py",),
        ("terms whose powers differ by a fraction", "and all((n - numbers[0]).is_integer() for n in numbers)", ""),
        ("what an exponential settles", "growth.degree.data <= 0.0 and not", "growth.degree.data <= 1.0 and not"),
    ),
    *mutants(
        "teg/numerics/arcs.py",
        ("tests/numerics/test_arcs.py",),
        ("the longest arc", "return 2.0 * wave / max(degree, 1)", "return 4.0 * wave / max(degree, 1)"),
    ),
    *mutants(
        "teg/numerics/error_function.py",
        ("tests/numerics/test_error_function.py",),
        ("erf is odd", "return -inverse_erf(-c)", "return inverse_erf(-c)"),
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
)
