"""Single wrong changes of expressions, of analyses, and of formulas of numbers."""

from __future__ import annotations

from tests.mutation.mutant import Mutant, mutants

STEPS = "tests/passes/normalise/test_steps.py"
GUARDED = "tests/passes/lower/test_guarded.py"
QUADRATURE = "tests/numerics/test_quadrature.py"
SPHERES = ("tests/end_to_end/test_spheres.py",)

IN_ANALYSES: tuple[Mutant, ...] = (
    *mutants(
        "teg/analysis/roots.py",
        ("tests/analysis/test_roots.py", "tests/passes/eliminate/test_univariate.py", "tests/passes/eliminate/test_endless.py"),
        ("a discriminant as a product", "return mul(const(-4), a, c)", "pass"),
        ("a line that is everywhere", "met if met is TRUE or level.free else disjunction(met, negation(is_not_zero(level)))", "met"),
    ),
    *mutants(
        "teg/analysis/breaks.py",
        ("tests/analysis/test_breaks.py",),
        ("zeros of factors", "dict.fromkeys(factor for branch in branches for factor in _factors(branch, x))", "branches"),
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
        "teg/analysis/polynomial.py",
        ("tests/analysis/test_polynomial.py", "tests/passes/normalise/test_canonicalise.py"),
        ("the size of a negative number", "least = min(value % P, -value % P)", "least = value % P"),
        ("a branch at a point", "return (otherwise + (then - otherwise) *", "return (otherwise - (then - otherwise) *"),
        ("terms that a sum changes", "return dict(b) if factor == 1", "return b if factor == 1"),
    ),
    *mutants(
        "teg/ir/node.py",
        ("tests/ir/test_node.py",),
        ("kinds of what is below", "kinds |= c.kinds", "kinds |= c.own_kinds"),
        ("kinds of bases", 'cls.own_kinds |= getattr(base, "own_kinds", 0)', "pass"),
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
        "teg/ir/simplify.py",
        ("tests/ir/test_simplify.py",),
        ("powers of quotients", "if any([k * powers[product] * powers.get(base, 0) < 0", "if any([0 < 0"),
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
        "teg/analysis/preimages.py",
        ("tests/analysis/test_preimages.py",),
        ("zeros of a wave in an interval", "/ math.pi) + 3", "/ math.pi)"),
    ),
    *mutants(
        "teg/analysis/roots.py",
        ("tests/analysis/test_roots.py",),
        ("a root that is found twice", "return FALSE if i else TRUE", "return TRUE"),
        ("places that are found twice", "for other in roots[:i])", "for other in roots[:0])"),
    ),
    Mutant(
        "conditions on functions that may be no numbers",
        "teg/ir/integral.py",
        "outer = [c for c in outer if not _asks_partial_functions(c)]",
        "outer = [c for c in outer if c]",
        SPHERES,
    ),
    *mutants(
        "teg/analysis/preimages.py",
        ("tests/analysis/test_preimages.py",),
        ("an angle beyond a half turn", "exists = conjunction(_within(c, -math.pi, math.pi), positive(", "exists = conjunction(positive("),
    ),
    *mutants(
        "teg/analysis/projection.py",
        ("tests/analysis/test_projection.py",),
        ("a surface at a fixed bound", "fixed = self._fixed()", "fixed: dict[Expr, Expr] = {}"),
        ("the wider range of point masses", "if self.surface is None:\n            for bound", "if not apart:\n            for bound"),
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
        "teg/analysis/centres.py",
        ("tests/passes/lower/test_gaussian.py",),
        ("tails from outside", "for edge in edges if c.high else ():", "for edge in ():"),
        ("many surfaces of a density", "MAX_MET = 512", "MAX_MET = 8"),
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
        (GUARDED, "tests/passes/lower/test_far_features.py", "tests/end_to_end/test_infinite_ranges.py"),
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
    Mutant(
        "densities that a surface divides",
        "teg/analysis/centres.py",
        "surfaces if narrow else ()",
        "()",
        ("tests/passes/lower/test_gaussian.py",),
    ),
    *mutants(
        "teg/analysis/centres.py",
        ("tests/passes/lower/test_gaussian.py",),
        ("densities on a curve", "([] if masses is None else [masses.g])", "[]"),
        (
            "places on a curve that are looked for",
            "self.degrees.of(apart, x) not in (1, 2):\n                            searches",
            "False:\n                            searches",
        ),
    ),
    *mutants(
        "teg/analysis/constants.py",
        ("tests/analysis/test_constants.py",),
        ("products of two constants", "for other in others)]", "for other in ())]"),
        ("powers of a constant", "if math.isfinite(quotient) and quotient != 0.0:", "if powers == (1, 0):"),
    ),
    Mutant(
        "exponentials between edges that meet",
        "teg/analysis/centres.py",
        'for edge in edges if c.kind == "decay" else ():',
        "for edge in ():",
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
        "teg/analysis/critical.py",
        ("tests/passes/eliminate/test_charts.py", "tests/passes/eliminate/test_implicit.py", "tests/passes/eliminate/test_conic.py"),
        ("centres of squares", "split is not None and len(split[0])", "split is None and len(split[0])"),
        ("least height of a long ellipse", "mul(const(APART), critical.terms), mul", "mul(const(APART), critical.size), mul"),
        ("lengths beside a place", "mul(const(0.5 * APART), call", "mul(const(0.5), call"),
        ("least height of a birth", "add(least_height(critical), where", "add(ZERO, where"),
        ("least height of a crossing", "mul(const(APART), critical.size), ZERO)", "ZERO, ZERO)"),
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
)
