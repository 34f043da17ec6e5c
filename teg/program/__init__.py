"""The flat, scheduled program that every backend receives.

    stmt ::= name = op(args…)                                              Assign: one scalar, float64 or boolean
           | results = ∫ v in (lo, breaks…, hi) by rule: flags; body       Integrate: pieces between breaks, nodes in a piece
           | results = roots of g in v in [lo, hi]                         Isolate: interval bisection, then Newton's method
           | results = places v where f = g = 0 in a rectangle            Locate: interval bisection; hints where to break, and what was
                                                                          given up
           | results = Σ v in points: body                                 SumOver: the roots found by an Isolate
           | results = mean over points (v, …) of the unit cube: body      Sample: pseudo-random, or Sobol' points in replicates
           | results = ∫∫ over a box cut by half-planes: setup; body       Polygon: the box is clipped, a rule on a fan of triangles
           | results = ∫ over (0, 1) cut by half-lines: setup; body        Segment: the interval is clipped, Gauss-Legendre on what is left
           | results = Σ c·moments of [g > 0], [g <= 0], δ(g): scales     Hyperbola: g bilinear on the unit square, in closed form
           | when b: body with results                                     When: a branch; where it is not taken, results are 0

A program may call functions whose bodies are programs of their own (`Called`), without integrals.

A program is closed and free of δ. Every name is assigned exactly once in the whole program, and a statement uses only names of
its own block assigned earlier, of the enclosing blocks, or parameters. Floats are named 'v…', booleans 'b…', variables of
integration 'x…', parameters 'p…'; a `str` argument is a name, a `float`, `int` or `bool` argument is a literal.

Semantics of `Integrate` (the three printers share it to the letter):

    if `when` names a boolean that is false, every result is 0 and nothing below is evaluated
    if lo or hi is NaN, or infinite in an integral that is not `infinite`, every result is NaN
    s, a, b = +1, lo, hi  if lo <= hi  else  -1, hi, lo
    each break is clamped to [a, b] (a break that is NaN is absent: it is clamped to a); the breaks are sorted
    for neighbouring points p < q of a, breaks…, b with q - p > PIECE_EPS·max(|p|, |q|), or q - p infinite     (thinner pieces are skipped)
        v := p + INSIDE·(q - p), or the tail's place of INSIDE if q - p is infinite; run `flags`  (everything constant on the open piece),
            where the names `ends`, if there are any, are p and q
        skip the piece if `need` names a boolean that is false
        add to each value's sum its integral over (p, q) by `rule`, `body` being run at every node v
    results = s · sums; estimates = the sums of the error estimates of the first `len(estimates)` values

`Gauss(n)`: n-point Gauss-Legendre on each piece, in v, of a finite piece.

`Rational(n, m)`: Gauss-Legendre in v on each piece, of an integrand that is a polynomial of degree < n over D(v)^m there, D the linear
function of the only bend, a "pole", where that counts (`when`, finite coefficients), and a polynomial of degree < n elsewhere. With f the
values at the n nodes u in (-1, 1) of a piece, w their weights in Gauss-Legendre, D₋ and D₊ the values of D at p and q, W the size of the
larger of p and q as w, M as below and z = (D₊ - D₋)/(D₊ + D₋): where the bend counts and
    D₋·D₊ > 0 and min(|D₋|, |D₊|) > POLE·M·|c₁|
the weights are instead (1 + z·u)^m·∫ ℓ(t)/(1 + z·t)^m dt over (-1, 1), ℓ the Lagrange polynomials of the nodes; K is ½·L·Σ wf. If the
bend counts and this does not hold the pole is on the piece, and a value diverges if the first null rule gives more than RESIDUE·Σ w|f|:
then it is an infinity of K's sign, and the tolerance was missed. The estimate is that of `Gauss`; where the weights are those of a pole
m·EDGE·(|c₀| + |c₁|·W)/min(|D₋|, |D₊|) times A is added to it.

`Adaptive(tol, first, order, cubic)`: on each piece, in a coordinate u in (0, 1), Gauss-Legendre with bisection. The whole of (0, 1) is
measured with `first` nodes (not if there is something to watch); then, if it was not accepted, with `order` nodes, and so is every
interval that comes of halving one. Measuring an interval gives for every value K, the sum, A, the sum of |value|, and an error E; A₀ is
the first A of the piece. An interval is accepted if for each of the `tested` first values
    E <= max(tol·(A₀ + ABSOLUTE_FLOOR), ROUNDING·A), or E is not finite.
If it was bisected MAX_DEPTH times, or the piece has used MAX_INTERVALS measurements, it is accepted as well, but the tolerance was
*missed*, and the run's outcome says so, as it does where K is infinite, or where the errors of a piece (but for intervals in which a
watched boolean changes) add up to more than SPENT times what one of them may be; after DEEP bisections a value with A > DIVERGENT·A₀
diverges: its K is replaced by an infinity of its sign.

The error E of n nodes: with e₁, …, e₆ the sizes of the six null rules of `teg.numerics.quadrature`,
    a, b, c = max(e₁, e₂), max(e₃, e₄), max(e₅, e₆);   t = max(a, b) if b > c else a;   r = max(a/b, b/c)·max(1, (a/b)/(b/c))³
    E = 4·t·min(1, max(r, (15·r - 2)/7))^decay_power(n), the power 1 where r is NaN and at an "end" (see below), or 0 if t <= NOISE·A
    the estimate is E + (½·ROUNDING + EDGE·M/L)·A, M = max(|p|, |q|), the last term for finite L
For `Gauss` E is 0: it is chosen where it is exact.

The place of u, v(u), on a piece of length L = q - p is the first of these that applies (nodes are kept within (p, q): one that is not
becomes the next number inside, which is a normal one in JAX):

    a tail, q or p infinite      p + scale·u/(1 - u),   q - scale·(1 - u)/u
    a bend                       see below
    `cubic`                      p + L·u²·(3 - 2u)                     (√-like behaviour at both ends becomes analytic)
    else                         p + L·u

`bends` are places where a function of v turns into another branch or has a pole: a Bend holds D(v) = c₀ + c₁·w + c₂·w², w = v - base, and
counts on a piece where its `when` (of `flags`) holds and its coefficients are finite. With P, Q the ends as w, y the zeros of D (with
c₂·W² <= 1e-13·(|c₁|·W + |c₀|), W = max(|P|, |Q|), D is linear; it has no zero if c₁·W <= 1e-13·|c₀|), and for complex y = m ± i·h its size
    s = 2·(|y - P| + |y - Q|)/L           (the sum of the distances from the foci of [-1, 1]; 2 on the piece, 2 + small near it)
a bend's s is that of its nearest zero; FAR zeros beside another one do not count. Two real zeros closer than 1e-12·L are none, nor
complex ones with h < 1e-100·L; nor is a "root" or "end" with a real zero inside of the piece, which should be a break; one that is inside
by at most 1e-9·L is moved to the end there. Of the bends with s < NEAR the nearest counts:

    "root", one zero           y ± t²                      √D is t
    "root", two real zeros     m + h·sin t  between them,  m ± h·cosh t  beyond them
    "root", complex zeros      m + h·sinh t
    "pole"                     y ± eᵗ,  y the nearest real zero; none within POLE·M of the piece; complex zeros as for a "root"
    "end"                      p + L·u⁶ if a zero is within 1e-9·L of p, q - L·(1 - u)⁶ if of q, not of both; else it is a "root"

with t linear in u. If two different bends have a zero within 1e-9·L of p and of q, one at either end, the place is the cubic's.

`Midpoint(n)`: on a finite piece v = p + (q - p)·((k + ½)/n), k = 0, …, n - 1, every value counted (q - p)/n times. The estimate is
½·(q - p)/n times Σₖ|fₖ₊₁ - fₖ|, what a function of that total variation can be off by, plus ½·ROUNDING·A.

`watch` names booleans of `body` that may change where no break is known (rule Adaptive only; by Gauss it is ignored). On an interval
`body` is then also run at the two ends, whose v come from u like a node's; of these two runs only the watched booleans count, no value,
NaN or not, and no tie. If at these points a watched boolean is not always the same, the error does not matter: the interval is halved,
unless it is at most WATCH_WIDTH wide in u, or MAX_DEPTH or MAX_INTERVALS was reached; then it is accepted, its K counts as any other.
An interval that will be halved anyway need not be evaluated further, but the first one is, for A₀.

Once the intervals of a run have been measured with more than MAX_EVALUATIONS nodes a point of the batch, or an iteration of a loop, each
that is still to be measured is accepted as one that was halved MAX_DEPTH times is: the tolerance was missed. Which these are, and which
nodes count, is for a backend to say. (JAX has no such limit.)

A `guard` (rule Adaptive only) finds what lies between all nodes. Its block computes for left <= v <= right a bound `sizes` of each tested
|value|, and bounds lower <= s <= upper of its *sharp* values, which the body computes at the nodes as `seen`. A₀ of an interval is then
the largest A among those of the interval itself and of the intervals it came from. An interval that would be accepted because its
errors are small, all being finite, and in which no watched boolean changes, is accepted only if nothing there is hidden. With
    a box (left, right) *matters* if right - left is not finite, or one of the tested values does not have
        size·(right - left) <= max(tol·(A₀ + ABSOLUTE_FLOOR), ROUNDING·A)
    s is *unseen* in it, S being a value of s at nodes, if  upper > UNSEEN·max(S, FAINT)  or  upper > HIDDEN·max(lower, FAINT)
nothing is hidden in the interval if
    the whole interval does not matter, or no s is unseen in it, S being the least at its nodes (one of all that are numbers);
    or in none of the gaps between neighbouring nodes, and between ends and nodes, that are finite and matter, an s is unseen, S being the
        larger of its two nodes' (at an end the one's); an infinite upper bound counts as seen in a gap at an end of the piece, and in
        every gap if the interval came from GUARD_DEPTH or more bisections: where the integrand is singular the nodes decide.
At the ends of a piece left and right are p and q themselves.

Semantics of `Isolate`: g is a smooth function of `var`. The block `point` computes `value` = g, `slope` = g′ and `curvature` = g″ at `var`
(NaN where g″ is not known). The block `enclosure` computes `bounds` = (g₋, g₊, d₋, d₊) and `curving` = (c₋, c₊) with g₋ <= g <= g₊,
d₋ <= g′ <= d₊ and c₋ <= g″ <= c₊ for all v with left <= v <= right, and `noise`, how far rounding may move g at ½(left + right).

    if `when` names a boolean that is false, every result and every error is +inf
    if lo or hi is NaN or infinite every result is NaN; if lo = hi every result is +inf; lo > hi are exchanged
    level 0 is the box (lo, hi). For each level 0, 1, …, ISOLATE_DEPTH, for each box (p, q) of it, with m = ½(p + q), h = ½(q - p):
        run `enclosure` at left := p, right := q; run `point` at m; g and g′ at p and q are known likewise
        the box is dropped if  d₋ = d₊ = 0:  g is constant there, and if it is 0 that is no isolated root
        the box *changes sign* if  g(p) <= 0 < g(q)  or  g(q) <= 0 < g(p); then it is kept, whatever rounded bounds say
        another box is dropped, for there is no root in it, if   g₋ > 0  or  g₊ < 0,
            or d₋ and d₊ are finite and  g(m) - h·max(|d₋|, |d₊|) > 0  or  g(m) + h·max(|d₋|, |d₊|) < 0     (mean value theorem),
            or g₋, g₊ and g(m) are all NaN                                                                     (g is not defined there)
        else if  d₋ > 0  or  d₊ < 0,  and g(p) and g(q) are numbers  (monotone): one root if it changes sign, else none
        else if  c₋ > 0  or  c₊ < 0,  and g and g′ are numbers at p and q  (convex or concave): one root if it changes sign; else none,
            unless it turns between p and q: one of g′(p), g′(q) is > 0 and the other is not, and g(p) > 0 if and only if c₋ > 0. Then,
            t being where g′ = 0, with the noise of `enclosure` at left := right := t: if |g(t)| <= noise < ∞ the root t twice (a
            tangency), else if one of g(t), g(p) is > 0 and the other is not two roots, in (p, t) and in (t, q), else none
        else if this is level ISOLATE_DEPTH, or |g(m)| + h·|g′(m)| + ½h²·max(|c₋|, |c₊|) <= noise < ∞ (lost in rounding): it is *undecided*
        else it is halved, (p, m) and (m, q) go to the next level, or (p, q) itself if m is not strictly between p and q
    more than `width` boxes on a level make every result NaN
    undecided boxes that share an end are joined; a joined box (p, q) gives one root ½(p + q) if it changes sign; else none if g(p) or g(q)
        is NaN (the border of where g is defined), else that root twice (a tangency)
    a root in a box that changes sign is found by Newton's method from v = m, kept in [p, q]: at each iterate v, if g = 0 it stops; else v
        replaces q if g > 0 is as at the box's right end, else p; a step -g/g′ that is 0 or not a number, leaves [p, q], or is longer than
        half of the step before the last one (if there was one), is replaced by a bisection, to ½(p + q). It stops after a step of at most
        2⁻⁵² times |v|, v being where it arrived, or after ISOLATE_STEPS steps; the last step is taken. A zero of g′ is found likewise
    results = the roots in ascending order, then +inf; more roots than results make every result NaN
    a root's *error* is ½(q - p) for a joined box, √(2·noise/|g″(t)|) for a tangency t, else 0; `errors` are those of the results (0 for
        +inf, NaN for NaN). If one is more than tol·|hi - lo|, the tolerance was missed

A search with more than `width` boxes on a level, or more roots than results, is *crowded*, and the run's outcome says so: the same
program with more room has the answer.

Semantics of `Locate`: f and g are functions of v, between `lo` and `hi`, and of u, between `low` and `high`. The block `enclosure` computes
`bounds` = (f₋, f₊, g₋, g₊), which hold f and g for all left <= v <= right and bottom <= u <= top; where they are known also such bounds of
∂f/∂v, ∂f/∂u, ∂g/∂v and ∂g/∂u. At a point, left = right and bottom = top, the lower bounds are values and slopes.

    if `when` names a boolean that is false, or lo, hi, low or high is not finite, or lo = hi, or low = high, every result is +inf, lost = 0
    lo > hi are exchanged, and low > high; V = hi - lo, U = high - low
    a rectangle that was halved i times in v and k times in u has the width 2^-i and the height 2^-k in parts of V and U; from its corner
        (r, s), in such parts too, it reaches from lo + V·r to lo + V·(r + 2^-i), and from low + U·s to low + U·(s + 2^-k). Level 0 is the
        whole one
    for each level 0, 1, …, for each rectangle of it run `enclosure`;
        it is dropped if  f₋ > 0  or  f₊ < 0  or  g₋ > 0  or  g₊ < 0,  or f₋ and f₊ are both NaN,  or g₋ and g₊ are
        else, if there are bounds of slopes, with f and g in its middle m, half its sides h and k, the largest sizes of the slopes s,
            their middles a, b, c, d (∂f/∂v, ∂f/∂u, ∂g/∂v, ∂g/∂u) and half of their widths r, D = |ad - bc|,
                V* = (|d|·r_a + |b|·r_c)·h/D + (|d|·r_b + |b|·r_d)·k/D,    U* = (|c|·r_a + |a|·r_c)·h/D + (|c|·r_b + |a|·r_d)·k/D,
            it is dropped if  |f| > s_a·h + s_b·k  or  |g| > s_c·h + s_d·k                                       (mean value theorem),
                or |df - bg|/D > h + V*  or  |ag - cf|/D > k + U*                                        (Krawczyk: no common zero)
            else there is one zero, which Newton's method finds, if
                V* <= h/4  and  U* <= k/4  and  |df - bg|/D + V* < h  and  |ag - cf|/D + U* < k
        else it is *left*
    with n rectangles left of the m of a level: if n = 0 the search is over; else, if i = k = LOCATE_HALVINGS, or 2n > LOCATE_WIDTH, or the
        next level would make more than LOCATE_MOST rectangles in all, it is over and they are given up; else each is halved: if the last
        halving in u was of no use, 50n >= 49m, and that in v was, 20n <= 11m, in v; if it is the other way round, in u; else in v if
        i <= k, in u if not. A direction that was halved LOCATE_HALVINGS times is not halved any more. The halves are the next level
    a zero is where LOCATE_STEPS steps of Newton's method lead from m; its interval is v ± LOCATE_SAME·V; more than LOCATE_ZEROS zeros,
        counted at the end of a level, end the search: then every result is +inf, and lost = 1
    the intervals of v of the zeros and of the rectangles given up are joined where they overlap or touch; an interval gives one place, its
        middle, if it is at most LOCATE_NARROW·V wide, else two, its ends, and the area of its rectangles is lost
    results = the places in ascending order, then +inf; lost = what is lost, in parts of VU, and if there are more places than results
        (hi - the last result)/V more, if that is > 0; it is at most 1
    if lost > LOCATE_LOST the tolerance was missed

Semantics of `SumOver`: if `when` names a boolean that is false, every result is 0; else if a point is NaN every result is NaN; else `body`
is run with `var` at each point that is finite, and each result is the sum of its value, in the order of the points.

Semantics of `Sample`: `points` names the coordinates of a point of the unit cube, all in (0, 1), by `teg.numerics.sobol` from `kind`,
`seed` and
its number. There are R = 8 replicates of n = ⌈count/8⌉ points for "qmc", and R = 1 of n = count for "montecarlo".

    if `when` names a boolean that is false, every result and every estimate is 0
    else `body` is run at each of the R·n points; mᵣ is the mean of a value over replicate r
    results = (m₁ + … + m_R)/R = m
    estimates = of the first `len(estimates)` values the standard error of m: √(Σᵣ(mᵣ - m)²/(R(R - 1))) for "qmc", √(Σᵢ(fᵢ - m)²/(n(n - 1)))
        over the n values fᵢ for "montecarlo" (relative to f₁, so that nothing cancels); NaN where m is not finite, or n = 1 there

Semantics of `Polygon`: u and v are offsets from a corner of a box, which is 0 and `width` apart in u, 0 and `height` in v (either may be
negative: then so is the area). A half-plane is g(u, v) = (c + a·u) + b·v > 0; on the box its least value is c + min(a·width, 0) +
min(b·height, 0), its largest likewise; it *fails* if the largest is <= 0, unless it is `closed` and the least is >= 0.

    if `when` names a boolean that is false, or a half-plane fails, every result is 0 and nothing below is evaluated
    if width, height, or the least or largest value of a half-plane is NaN or infinite, every result is NaN
    run `setup`; the polygon is the box, its corners (0, 0), (width, 0), (width, height), (0, height)
    for each half-plane in order, unless its least value is >= 0, the polygon is clipped: with g at its vertices, for each vertex q
        after its predecessor p, the first after the last:  if one of g(p), g(q) is > 0 and the other < 0, the vertex i + t·(o - i) with
        t = g(i)/(g(i) - g(o)), i the one where g > 0, o the other;  then q itself if g(q) >= 0                    (Sutherland and Hodgman)
    results = Σ of the rule `teg.numerics.quadrature.triangle_rule(degree)` over the triangles (vertex 0, vertex k, vertex k + 1), k = 1,
    2, …,
        a node (r, s) of weight w being at p₀ + r·(p₁ - p₀) + s·(p₂ - p₀) and counting w·½((p₁ - p₀) × (p₂ - p₀)) times; times
        `factors`. With degree 0 one node, vertex 0, counts for all of them.

With `corners`, three points p₀, p₁, p₂ in (u, v), half-plane k of the first three is 0 at two of them, and `across` at p_k; `variables` has
two names more, a node's barycentric coordinates, 1 at p₁ and 1 at p₂ and 0 at the others. If `across` <= 0 every result is 0. With s the
largest difference of largest and least of the three, the polygon is *thin* if across < THIN·s. Then instead of the box p₀p₁p₂ is clipped,
or p₀p₂p₁ if that turns as the box does, by σu >= 0 and σ(width - u) >= 0, σ the sign of width, where an edge that is cut has u = 0 and
u = width, by v likewise, and by the half-planes from number 3 on; a new vertex divides the coordinates of an edge as it does u and v.
Else they are the values of half-planes 1 and 2, times 1/across.

Semantics of `Segment`: t is in (0, 1). A half-line is g(t) > 0 with g affine, given by its values at 0 and at 1 (`first`, `last`).

    if `when` names a boolean that is false, every result is 0 and nothing below is evaluated
    run `setup`; from, to = 0, 1
    a half-line that may tie is *near* if |first| and |last| are at most NEARLY·size and finite; run `scales` if one is; a near one *ties*
        if both are at most TIE_EPS·scale: it holds where `resolution` does, if the program's run-time input `order` is +1, or where it
        does not, if that is -1, and a tie was met
    if a half-line that does not tie has first <= 0 and last <= 0, unless it is `closed` and both are 0, or ties and does not hold, every
        result is 0
    if first - last of a half-line that does not tie is NaN or infinite, every result is NaN
    each half-line that does not tie and with first·last < 0 in sign moves an end to first/(first - last): `from`, where first < 0, if that
        is larger; `to`, where first > 0, if that is smaller
    if from >= to every result is 0; else results = `factors` times Gauss-Legendre with `nodes` nodes over (from, to), `body` being run at
        each t

Semantics of `Hyperbola`: g is affine in u and in v on the unit square, with the values `corners` at (0, 0), (1, 0), (1, 1), (0, 1); side i
begins at corner i. Each result is Σ c·∫∫ uʲvᵏ w du dv over its `terms` (j, k, c), with the weight w by its kind,

    "above"  [g > 0]        "below"  [g <= 0]        "border"  δ(g)

    if `when` names a boolean that is false, every result is 0 and nothing below is evaluated
    if a corner is NaN or infinite, every result is NaN
    with `ties`, if the |g| at the ends of a side add up to at most NEAR_SIDE times those of all corners, run `scales`: a side *ties* if |g|
        is at most TIE_EPS·scale at both of its ends. Unless all corners are ends of such sides, these are then set to 0, they count as
        g > 0 if the program's run-time input `order` is +1 and as g <= 0 if it is -1, and a tie was met
    if g > 0 at all corners, or at none, the region is all of the square, or nothing, a border is 0, and of the results only those
        of the region that is not empty look at their coefficients; else both kinds of regions and the border are those of
        `teg.numerics.moments`
    where a border's curve crosses itself on the square, |g| <= SADDLE·Σ|g in the middles of the sides| at the saddle, and the polynomial
        there is more than NO_FLUX times the sum of its sizes in the middles of the sides, the result is an infinity of its sign

Semantics of `When`: if `when` is false every result is 0 and nothing of `body` is run. Else `body` is run, which gives the results their
values. Nothing else in it is known outside. It stands in the outermost block or in another `When`.

A polygon's `met` names a boolean that is false only where a half-plane fails; backends make branches of it (`teg.backends.branches`), and
it is in no program that they print.

Operations (arithmetic is plain IEEE double, without contraction to fused multiply-add):

    floats    const(x)  add(x, y, …)  sub(x, y)  mul(x, y, …)  div(x, y)  neg(x)  powi(x, n)  pow(x, y)  abs(x)  floor(x)  mod(x, y)
              sin cos tan asin acos atan sinh cosh tanh exp log sqrt (x)   atan2(y, x)   select(b, x, y)   min(x, y)  max(x, y)
              call(k, x, …), function k of the program, an integer literal
    booleans  gt0 ge0 lt0 le0 (x)   ok(x)   and(b, …)  or(b, …)  not(b)   tie(g, scale, r, k)

`add` and `mul` associate to the left. `powi` has an integer literal, negative ones are 1/powi(x, -n). `mod` has the sign of its second
argument (x - y·floor(x/y)). `min` and `max` are NaN if an argument is. `select` takes x where b holds and never lets the other value
through. `ok(x)` is x == x: not NaN.

`tie(g, scale, r, k)` is g > 0, but where |g| <= TIE_EPS·scale and g is finite the point lies on two surfaces at once and the program's
run-time input `order` (+1 or -1) decides: r if order = +1, not r if order = -1. A program with ties is run with order = +1; if any tie
was met it is run again with order = -1 and the outputs are averaged. `k` numbers the tie in `Program.ties`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np

PIECE_EPS = 4 * 2.0**-52
TIE_EPS = 4 * 2.0**-52
INSIDE = 0.4854101966249685
"""Where in a piece its conditions are decided: not in its middle, where by symmetry two surfaces may touch."""
ABSOLUTE_FLOOR = 1e-6
ROUNDING = 64 * 2.0**-52
MAX_DEPTH = 48
MAX_INTERVALS = 2**17
MAX_EVALUATIONS = 2**28
"""Of integrands, that one point may take: some seconds of a compiled kernel."""
WATCH_WIDTH = 2.0**-44
NOISE = 10 * 2.0**-52
EDGE = 4 * 2.0**-52
"""How far an end of a piece may be off, relative to its distance from 0: of a thin piece that is much."""
SPENT = 10.0
DIVERGENT = 2.0**-10
UNSEEN = 1e3
"""A sharp value that may be so many times larger in a gap than at the nodes beside it was not seen by them."""
HIDDEN = 1e13
"""Where a sharp value falls by such a factor in one gap, a product with one that rises there may have a peak between the nodes."""
FAINT = 1e-87
"""A sharp value below which no peak is looked for: that of exp(-200)."""
GUARD_DEPTH = 12
DEEP = 40
POLE = 16 * 2.0**-52
"""A pole that near to a piece, relative to its distance from 0, may be on it."""
RESIDUE = 1e-8
"""An integrand whose highest coefficient is less than that, relative to its size, has no pole."""
FAR = 64.0
"""The size of a zero that is too far to count beside another one: what it costs is less than the rounding of large numbers."""
NEAR = 6.0 + 1.0 / 6.0
"""The size of a bend whose ellipse is ρ = 6: Gauss-Legendre with 12 nodes errs there by 6⁻²⁴."""
ISOLATE_DEPTH = 40
ISOLATE_WIDTH = 128
ISOLATE_STEPS = 100
LOCATE_HALVINGS = 36
LOCATE_WIDTH = 4096
LOCATE_MOST = 2**15
LOCATE_ZEROS = 512
LOCATE_STEPS = 6
"""Steps of Newton's method: the first one leaves a quarter of the rectangle at most, and each doubles the digits."""
LOCATE_NARROW = 2.0**-30
LOCATE_SAME = 2.0**-40
LOCATE_LOST = 2.0**-40
"""A smaller part of the rectangle may be given up."""
MAX_HALF_PLANES = 64
"""Of more a `Polygon` would be long: they share the pieces of two integrals instead."""
THIN = 2.0**-5
"""A triangle so thin, compared with how much its half-planes change over a box, is clipped by the box, and not the box by it."""
NEARLY = 2.0**-20
"""A half-line whose values are so small, compared with its terms, may be a tie: only then is it worth knowing how much rounding did."""

NEAR_SIDE = 2.0**-10
"""A side at whose ends a bilinear function is so small, compared with all corners, may be a tie."""
SMALLEST = 1e-140
"""The products of numbers that are smaller, or larger than its inverse, may be lost: they are divided first."""
LARGEST_RATIO = 1e24
"""Of the slopes at both ends of a branch that begins or ends on an asymptote, to rounding."""
SADDLE = 8 * 2.0**-52
"""The value at a saddle that is 0 to rounding, relative to those on the sides of the box."""
NO_FLUX = 1e-12
"""A boundary term's factor that is smaller than this at a saddle, in parts of its values on the box, is 0 there."""

Arg = str | float | int | bool


@dataclass(frozen=True, slots=True)
class Gauss:
    """Gauss-Legendre with `nodes` nodes a piece: exact to degree 2·nodes - 1."""

    nodes: int


@dataclass(frozen=True, slots=True)
class Rational:
    """Gauss-Legendre with weights that know a pole, `nodes` nodes a piece: exact for polynomials of lower degree over D^power."""

    nodes: int
    power: int


@dataclass(frozen=True, slots=True)
class Adaptive:
    """Gauss-Legendre with bisection, to a relative tolerance on each piece: `first` nodes, then `order` nodes."""

    tol: float
    first: int = 10
    order: int = 18
    cubic: bool = False


@dataclass(frozen=True, slots=True)
class Midpoint:
    """The composite midpoint rule with `nodes` nodes a piece."""

    nodes: int


Rule = Gauss | Rational | Adaptive | Midpoint


@dataclass(frozen=True, slots=True)
class Assign:
    """name = op(args…)."""

    name: str
    op: str
    args: tuple[Arg, ...]


@dataclass(frozen=True, slots=True)
class Bend:
    """Where the integrand turns into another branch, or has a pole: the zeros of c₀ + c₁·w + c₂·w², w = v - base of its integral."""

    kind: str  # "root", "pole" or "end"
    coefficients: tuple[Arg, Arg, Arg]
    when: Arg = True


@dataclass(frozen=True, slots=True)
class Guard:
    """Bounds over left <= v <= right: of the sizes of tested values, and of sharp values, which are `seen` at nodes."""

    left: str
    right: str
    block: tuple[Stmt, ...]
    sizes: tuple[Arg, ...]
    upper: tuple[Arg, ...]
    lower: tuple[Arg, ...]
    seen: tuple[Arg, ...]


@dataclass(frozen=True, slots=True)
class Integrate:
    """results = ∫ values over `var` from lo to hi, piece by piece between the breaks.

    `tested` of the values decide how fine the pieces are cut; `infinite`: a bound may be, and tails have the length `scale`.
    """

    var: str
    lo: Arg
    hi: Arg
    breaks: tuple[Arg, ...]
    flags: tuple[Stmt, ...]
    need: str | None
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    results: tuple[str, ...]
    rule: Rule
    when: str | None = None
    watch: tuple[str, ...] = ()
    bends: tuple[Bend, ...] = ()
    base: Arg = 0.0
    infinite: bool = False
    scale: Arg = 1.0
    estimates: tuple[str, ...] = ()
    guard: Guard | None = None
    ends: tuple[str, ...] = ()

    @property
    def tested(self) -> int:
        """How many of the values count for the error: all, or those that have estimates."""
        return len(self.estimates) or len(self.values)

    @property
    def at_nodes(self) -> tuple[Arg, ...]:
        """The arguments that `body` computes at a node: values, watched booleans, sharp values."""
        watch = self.watch if isinstance(self.rule, Adaptive) else ()
        return (*self.values, *watch, *(self.guard.seen if self.guard is not None else ()))


@dataclass(frozen=True, slots=True)
class Isolate:
    """results = the roots of g between lo and hi, ascending, +inf for those that are not there; `errors`: how far each may be off."""

    var: str
    lo: Arg
    hi: Arg
    left: str
    right: str
    enclosure: tuple[Stmt, ...]
    bounds: tuple[Arg, Arg, Arg, Arg]
    point: tuple[Stmt, ...]
    value: Arg
    slope: Arg
    results: tuple[str, ...]
    when: str | None = None
    curving: tuple[Arg, Arg] = (-math.inf, math.inf)
    noise: Arg = 0.0
    curvature: Arg = math.nan
    tol: float = math.inf
    width: int = ISOLATE_WIDTH
    errors: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Locate:
    """results = where in (lo, hi) f and g have a common zero over (low, high), ascending, +inf for those that are not there.

    `bounds` are those of f and g, then, if they are known, those of ∂f/∂v, ∂f/∂u, ∂g/∂v and ∂g/∂u; `lost` names the part of the rectangle
    that was given up.
    """

    lo: Arg
    hi: Arg
    low: Arg
    high: Arg
    left: str
    right: str
    bottom: str
    top: str
    enclosure: tuple[Stmt, ...]
    bounds: tuple[Arg, ...]
    results: tuple[str, ...]
    when: str | None = None
    lost: str | None = None


@dataclass(frozen=True, slots=True)
class SumOver:
    """results = Σ values with `var` at each of the points that is finite."""

    var: str
    points: tuple[Arg, ...]
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    results: tuple[str, ...]
    when: str | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """results = the means of the values over `count` points of the unit cube, whose coordinates are called `points`."""

    points: tuple[str, ...]
    count: int
    kind: str  # "montecarlo" or "qmc"
    seed: int
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    results: tuple[str, ...]
    estimates: tuple[str, ...] = ()
    when: str | None = None


@dataclass(frozen=True, slots=True)
class HalfPlane:
    """c + a·u + b·v > 0, or >= 0 if it is closed."""

    a: Arg
    b: Arg
    c: Arg
    closed: bool = False


@dataclass(frozen=True, slots=True)
class Polygon:
    """results = factors · ∫∫ values over the part of a box that is in all half-planes; exact to `degree` in both variables together."""

    variables: tuple[str, ...]
    width: Arg
    height: Arg
    half_planes: tuple[HalfPlane, ...]
    setup: tuple[Stmt, ...]
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    factors: tuple[Arg, ...]
    results: tuple[str, ...]
    degree: int
    when: str | None = None
    met: Arg = True
    corners: tuple[tuple[Arg, Arg], ...] = ()
    across: Arg = 0.0


@dataclass(frozen=True, slots=True)
class HalfLine:
    """g > 0, or >= 0 if it is closed, by the values at both ends; one that may be a tie has a number k, a resolution, the size of its terms
    and, in `scales`, the scale of its rounding errors."""

    first: Arg
    last: Arg
    closed: bool = False
    k: int | None = None
    resolution: Arg = True
    size: Arg = 0.0
    scale: Arg = 0.0


@dataclass(frozen=True, slots=True)
class Segment:
    """results = factors · ∫ values over the part of (0, 1) that is in all half-lines, by Gauss-Legendre with `nodes` nodes."""

    var: str
    half_lines: tuple[HalfLine, ...]
    setup: tuple[Stmt, ...]
    scales: tuple[Stmt, ...]
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    factors: tuple[Arg, ...]
    results: tuple[str, ...]
    nodes: int
    when: str | None = None


@dataclass(frozen=True, slots=True)
class Moments:
    """Σ c·uʲvᵏ over (j, k, c), on a region or along its border: "above", "below" or "border"."""

    kind: str
    terms: tuple[tuple[int, int, Arg], ...]


@dataclass(frozen=True, slots=True)
class Hyperbola:
    """results = moments of a bilinear g on the unit square; with a border, `ties` are the numbers of its four sides in `Program.ties`,
    and `scale` the scales of the rounding errors of its corners, known in `scales`."""

    corners: tuple[Arg, ...]
    scales: tuple[Stmt, ...]
    scale: tuple[Arg, ...]
    ties: tuple[int, ...]
    moments: tuple[Moments, ...]
    results: tuple[str, ...]
    when: str | None = None


@dataclass(frozen=True, slots=True)
class When:
    """Run `body`, which gives the results their values, if `when` holds; else they are 0."""

    when: str
    body: tuple[Stmt, ...]
    results: tuple[str, ...]


Stmt = Assign | Integrate | Isolate | Locate | SumOver | Sample | Polygon | Segment | Hyperbola | When


def blocks(stmt: Stmt) -> tuple[tuple[Stmt, ...], ...]:
    """The blocks inside a statement, in the order they are run."""
    match stmt:
        case Assign():  # most of them
            return ()
        case Integrate():
            return (stmt.flags, stmt.body) if stmt.guard is None else (stmt.flags, stmt.body, stmt.guard.block)
        case Isolate():
            return (stmt.enclosure, stmt.point)
        case Locate():
            return (stmt.enclosure,)
        case SumOver() | Sample() | When():
            return (stmt.body,)
        case Polygon():
            return (stmt.setup, stmt.body)
        case Segment():
            return (stmt.setup, stmt.scales, stmt.body)
        case Hyperbola():
            return (stmt.scales,)


class Outcome(NamedTuple):
    """What a run of a program gives: its outputs, (outputs, n), whether a tolerance was missed anywhere, the number of evaluations of
    integrands without integrals inside (0 if the kernel was not asked to count), and whether a search found more roots than it has room
    for."""

    values: np.ndarray
    missed: bool
    evaluations: int
    crowded: bool = False


@dataclass(frozen=True, slots=True)
class Tie:
    """What a `tie` operation compares, for diagnosis: two surfaces, printed."""

    surfaces: tuple[str, str]


class Printed(dict[object, Any]):
    """What backends printed of a program, but for the bodies of its functions: every binding of these shares it. It is not pickled."""

    def __reduce__(self) -> tuple[object, ...]:
        return (Printed, ())


@dataclass(frozen=True, slots=True)
class Called:
    """A function that a program calls: whose it is, how often it is differentiated by each input, and its body, a program with one output
    and a parameter an input; None until it is bound."""

    callee: object
    derivative: tuple[int, ...]
    body: Program | None = None


@dataclass(frozen=True, slots=True)
class Program:
    """A scheduled program: parameters (in order), statements, one output name or literal per result."""

    parameters: tuple[str, ...]  # the user's names, any text; in the program parameter i is called 'p{i}'
    body: tuple[Stmt, ...]
    outputs: tuple[Arg, ...]
    ties: tuple[Tie, ...] = ()
    functions: tuple[Called, ...] = ()
    printed: Printed = field(init=False, default_factory=Printed, compare=False, repr=False)  # `dataclasses.replace` begins a new one


def assigned(stmt: Stmt) -> tuple[str, ...]:
    """The names a statement gives a value."""
    match stmt:
        case Assign():
            return (stmt.name,)
        case Integrate() | Sample():
            return (*stmt.results, *stmt.estimates)
        case Isolate():
            return (*stmt.results, *stmt.errors)
        case Locate() if stmt.lost is not None:
            return (*stmt.results, stmt.lost)
        case _:
            return stmt.results


def statements(block: tuple[Stmt, ...]) -> Iterator[Stmt]:
    """Every statement of a block and of the blocks inside it, outermost first."""
    stack = list(reversed(block))
    while stack:
        stmt = stack.pop()
        yield stmt
        if not isinstance(stmt, Assign):
            for inner in reversed(blocks(stmt)):
                stack.extend(reversed(inner))


def compound(block: tuple[Stmt, ...]) -> Iterator[Stmt]:
    """The same but for assignments, which are most of them."""
    stack = [s for s in reversed(block) if not isinstance(s, Assign)]
    while stack:
        stmt = stack.pop()
        yield stmt
        for inner in reversed(blocks(stmt)):
            stack += [s for s in reversed(inner) if not isinstance(s, Assign)]


def has_ties(block: tuple[Stmt, ...]) -> bool:
    """Whether a run of a block can meet a tie."""
    waiting = [block]
    while waiting:
        stmts = waiting.pop()
        for s in stmts:
            if isinstance(s, Assign):
                if s.op == "tie":
                    return True
            elif (isinstance(s, Hyperbola) and s.ties) or (isinstance(s, Segment) and any(g.k is not None for g in s.half_lines)):
                return True
            else:
                waiting += blocks(s)
    return False


def size(program: Program) -> int:
    """Number of statements, nested ones included."""
    return sum(1 for _ in statements(program.body))


def without_branches(program: Program) -> Program:
    """The program with every `When` written out, for backends in which many points run together: what is not wanted is replaced by 0."""
    if not any(isinstance(s, When) for s in statements(program.body)):
        return program
    numbers = count(1 + max(int(n[1:]) for s in statements(program.body) for n in assigned(s) if n[1:].isdigit()))
    return replace(program, body=_written_out(program.body, numbers))


def _written_out(block: tuple[Stmt, ...], numbers: Iterator[int]) -> tuple[Stmt, ...]:
    """Recursion is as deep as branches are in each other; there are none in loops."""
    result: list[Stmt] = []
    for stmt in block:
        match stmt:
            case When():
                for inner in _written_out(stmt.body, numbers):
                    other = {name: f"v{next(numbers)}" for name in assigned(inner) if name in stmt.results}
                    result.append(_giving(inner, other))
                    result += [Assign(name, "select", (stmt.when, value, 0.0)) for name, value in other.items()]
            case _:
                result.append(stmt)
    return tuple(result)


def _giving(stmt: Stmt, names: dict[str, str]) -> Stmt:
    """The same statement with other names for what it gives a value."""
    if not names:
        return stmt
    if isinstance(stmt, Assign):
        return replace(stmt, name=names[stmt.name])
    return replace(stmt, results=tuple(names.get(r, r) for r in stmt.results))


def clipped_by(stmt: Polygon | Segment) -> tuple[Arg, ...]:
    """What decides the domain of a polygon or a segment; but for the scales of ties, which are known in the block for them only."""
    if isinstance(stmt, Polygon):
        known = (stmt.across, *(arg for p in stmt.corners for arg in p)) if stmt.corners else ()
        return (stmt.width, stmt.height, *(arg for g in stmt.half_planes for arg in (g.a, g.b, g.c)), *known)
    return tuple(arg for g in stmt.half_lines for arg in (g.first, g.last, *((g.resolution, g.size) if g.k is not None else ())))
