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

A polygon's `met` names a boolean that is false only where a half-plane fails; it is there for the pass that makes branches, and in no
program that is printed.

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

from teg.program.limits import (
    ABSOLUTE_FLOOR,
    DEEP,
    DIVERGENT,
    EDGE,
    FAINT,
    FAR,
    GUARD_DEPTH,
    HIDDEN,
    INSIDE,
    ISOLATE_DEPTH,
    ISOLATE_STEPS,
    ISOLATE_WIDTH,
    LARGEST_RATIO,
    LOCATE_HALVINGS,
    LOCATE_LOST,
    LOCATE_MOST,
    LOCATE_NARROW,
    LOCATE_SAME,
    LOCATE_STEPS,
    LOCATE_WIDTH,
    LOCATE_ZEROS,
    MAX_DEPTH,
    MAX_EVALUATIONS,
    MAX_HALF_PLANES,
    MAX_INTERVALS,
    NEAR,
    NEAR_SIDE,
    NEARLY,
    NO_FLUX,
    NOISE,
    PIECE_EPS,
    POLE,
    RESIDUE,
    ROUNDING,
    SADDLE,
    SMALLEST,
    SPENT,
    THIN,
    TIE_EPS,
    UNSEEN,
    WATCH_WIDTH,
)
from teg.program.statements import (
    Adaptive,
    Arg,
    Assign,
    Bend,
    Called,
    Gauss,
    Guard,
    HalfLine,
    HalfPlane,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Midpoint,
    Moments,
    Outcome,
    Polygon,
    Printed,
    Program,
    Rational,
    Rule,
    Sample,
    Segment,
    Stmt,
    SumOver,
    Tie,
    When,
)
from teg.program.walk import (
    assigned,
    blocks,
    captured,
    clipped_by,
    compound,
    free_in,
    free_names,
    has_ties,
    size,
    statements,
    without_branches,
)

__all__ = [
    "ABSOLUTE_FLOOR",
    "DEEP",
    "DIVERGENT",
    "EDGE",
    "FAINT",
    "FAR",
    "GUARD_DEPTH",
    "HIDDEN",
    "INSIDE",
    "ISOLATE_DEPTH",
    "ISOLATE_STEPS",
    "ISOLATE_WIDTH",
    "LARGEST_RATIO",
    "LOCATE_HALVINGS",
    "LOCATE_LOST",
    "LOCATE_MOST",
    "LOCATE_NARROW",
    "LOCATE_SAME",
    "LOCATE_STEPS",
    "LOCATE_WIDTH",
    "LOCATE_ZEROS",
    "MAX_DEPTH",
    "MAX_EVALUATIONS",
    "MAX_HALF_PLANES",
    "MAX_INTERVALS",
    "NEAR",
    "NEARLY",
    "NEAR_SIDE",
    "NOISE",
    "NO_FLUX",
    "PIECE_EPS",
    "POLE",
    "RESIDUE",
    "ROUNDING",
    "SADDLE",
    "SMALLEST",
    "SPENT",
    "THIN",
    "TIE_EPS",
    "UNSEEN",
    "WATCH_WIDTH",
    "Adaptive",
    "Arg",
    "Assign",
    "Bend",
    "Called",
    "Gauss",
    "Guard",
    "HalfLine",
    "HalfPlane",
    "Hyperbola",
    "Integrate",
    "Isolate",
    "Locate",
    "Midpoint",
    "Moments",
    "Outcome",
    "Polygon",
    "Printed",
    "Program",
    "Rational",
    "Rule",
    "Sample",
    "Segment",
    "Stmt",
    "SumOver",
    "Tie",
    "When",
    "assigned",
    "blocks",
    "captured",
    "clipped_by",
    "compound",
    "free_in",
    "free_names",
    "has_ties",
    "size",
    "statements",
    "without_branches",
]
