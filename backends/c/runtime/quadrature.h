/* Adaptive quadrature: errors by null rules, and sharp values that no node saw. */

//: teg_interval
/* An interval of u in (0, 1) that waits for its turn; the longest queue is TEG_MAX_DEPTH + 1. */
typedef struct {
    double from, to;
    int depth;
} teg_interval;

//: teg_node
/* A node of Gauss-Legendre on (-1, 1): its weight, its weights in the six null rules, and its weight in the sum of sizes. */
typedef struct {
    double node, rule[8];
} teg_node;

//: teg_decay
/* The largest coefficients that the six null rules behind a sum give, and their decay from one pair to the next, 1 where there is
   none. */
static inline double teg_decay(const double *sums, double *decay)
{
    const double e1 = fabs(sums[1]), e2 = fabs(sums[2]), e3 = fabs(sums[3]), e4 = fabs(sums[4]);
    const double e5 = fabs(sums[5]), e6 = fabs(sums[6]);
    const double a = e1 > e2 ? e1 : e2, b = e3 > e4 ? e3 : e4, c = e5 > e6 ? e5 : e6;
    const double last = a / b, before = b / c, slowing = last / before;
    double ratio = last > before ? last * (slowing * slowing * slowing) : before;
    if (ratio > 0.25) ratio = (15.0 * ratio - 2.0) / 7.0;
    *decay = ratio < 1.0 && last == last ? ratio : 1.0;
    return b > c && b > a ? b : a;
}

//: teg_at_ends
/* What the values at the ends of an interval show that those at the nodes do not: `apart` has how far each of the two lies from
   the polynomial through the nodes, and gets the error of each of n values in the place of the first one. */
static inline void teg_at_ends(int n, const double *sums, double *apart, double gap)
{
    for (int j = 0; j < n; j++, sums += 8, apart += 2) {
        double decay, found = 0.0;
        const double usual = TEG_END_DECAY * teg_decay(sums, &decay), least = usual * decay;
        for (int side = 0; side < 2; side++) {
            const double y = fabs(apart[side]);
            if (isfinite(y) && y > least) found += gap * y;
        }
        apart[0] = found > TEG_NOISE * sums[7] ? found : 0.0;
    }
}

//: teg_assess
/* The errors of n values from their sums: 8 numbers each, the sum, the six null rules, and the sum of sizes. The error of a
   value is written in the place of its first null rule, with what is in `apart`, unless this is NULL. Whether all are small
   enough, or not finite. */
static inline int teg_assess(int n, double *sums, const double *apart, const double *whole, double tol, double floor, int power)
{
    int good = 1;
    for (int j = 0; j < n; j++, sums += 8) {
        double decay;
        const double tail = teg_decay(sums, &decay);
        double error = 4.0 * tail;
        if (tail <= TEG_NOISE * sums[7]) error = 0.0;
        else if (decay < 1.0) for (int k = 0; k < power; k++) error *= decay;
        if (apart) error += 4.0 * apart[2 * j];
        const double rounding = TEG_ROUNDING * sums[7], wanted = tol * (whole[j] + floor);
        if (error > (wanted > rounding ? wanted : rounding) && isfinite(error)) good = 0;
        sums[1] = error;
    }
    return good;
}

//: teg_overspent
/* Whether the errors that were spent on a piece are too large together, for its integrals of |values|, or for its integrals,
   where values cancel. */
static inline int teg_overspent(
    int n, const double *spent, const double *whole, const double *total, double tol, double floor)
{
    for (int j = 0; j < n; j++) {
        const double rounding = TEG_SPENT * TEG_ROUNDING * whole[j], wanted = TEG_SPENT * tol * (whole[j] + floor);
        const double left = TEG_CANCELLED * tol * (fabs(total[j]) + TEG_CANCELS), least = wanted < left ? wanted : left;
        if (spent[j] > (least > rounding ? least : rounding)) return 1;
    }
    return 0;
}

//: teg_largest
/* The largest sums of sizes that were measured: of the whole piece, and of an interval and those it came from, a row a depth. */
static inline void teg_largest(int n, const double *sums, double *whole, double *above, int depth, int used)
{
    double *const row = above + depth * n;
    for (int j = 0; j < n; j++) {
        const double size = sums[8 * j + 7], before = depth ? row[j - n] : used > 1 ? row[j] : 0.0;
        whole[j] = fmax(whole[j], size);
        row[j] = fmax(before, size);
    }
}

//: teg_settled
/* Whether all errors are finite. */
static inline int teg_settled(int n, const double *sums)
{
    for (int j = 0; j < n; j++) if (!isfinite(sums[8 * j + 1])) return 0;
    return 1;
}

//: teg_wanted
/* What the error of one value may be: no less than its rounding. */
static inline double teg_wanted(const double *sums, double above, double tol, double floor)
{
    const double rounding = TEG_ROUNDING * sums[7], wanted = tol * (above + floor);
    return wanted > rounding ? wanted : rounding;
}

//: teg_tolerated
/* The least error that does not matter. */
static inline double teg_tolerated(int n, const double *sums, const double *above, double tol, double floor)
{
    double least = INFINITY;
    for (int j = 0; j < n; j++) {
        const double wanted = teg_wanted(sums + 8 * j, above[j], tol, floor);
        if (!(least <= wanted)) least = wanted;
    }
    return least;
}

//: teg_matters
/* Whether a box of this length may hold more of a value than its error may be. */
static inline int teg_matters(int n, const double *sizes, double length, const double *sums, const double *above, double tol, double floor)
{
    for (int j = 0; j < n; j++) {
        if (!isfinite(length) && sizes[j] == 0.0) continue;
        if (!(sizes[j] * length <= teg_wanted(sums + 8 * j, above[j], tol, floor))) return 1;
    }
    return 0;
}

//: teg_unseen
/* Whether one of n sharp values can be large in a gap, or in all of an interval (gap -1), and was not seen to be at the
   nodes, (nodes, n). Bounds are the n upper ones, then the lower ones, then what is below the upper ones, of which `most` does
   not matter; an infinite one counts in gaps that are inside or endless only, lower ones not in a gap that is endless, or
   outermost after many bisections. */
static inline int teg_unseen(int n, const double *bounds, double most, const double *seen, int nodes, int gap, int inside, int endless)
{
    for (int i = 0; i < n; i++) {
        const double upper = bounds[i], lower = bounds[n + i];
        double s = NAN;
        if (gap < 0) for (int k = 0; k < nodes; k++) s = seen[n * k + i] < s || isnan(s) ? seen[n * k + i] : s;
        else s = fmax(gap > 0 ? seen[n * (gap - 1) + i] : NAN, gap < nodes ? seen[n * gap + i] : NAN);
        if ((gap >= 0 && !inside && isinf(upper)) || bounds[2 * n + i] <= most) continue;
        if (upper > TEG_UNSEEN * fmax(s, TEG_FAINT)) return 1;
        if (upper > TEG_HIDDEN * fmax(lower, TEG_FAINT) && !(gap >= 0 && endless)) return 1;
    }
    return 0;
}

//: teg_placed
/* What the rounding of places does to an integral over an interval, relative to that of |values|, from the places of its ends
   and of its middle, by which an infinite end is replaced. */
static inline double teg_placed(double left, double middle, double right)
{
    const double p = isfinite(left) ? left : middle, q = isfinite(right) ? right : middle;
    const double apart = q > p ? TEG_PLACED * fmax(fabs(p), fabs(q)) / (q - p) : 1.0;
    return apart < 1.0 ? apart : 1.0;
}

//: teg_rounding
/* What rounding does to an integral over (p, q), relative to that of |values|: theirs, and that of the ends. */
static inline double teg_rounding(double p, double q)
{
    const double left = fabs(p), right = fabs(q);
    return 0.5 * TEG_ROUNDING + (isfinite(q - p) ? TEG_EDGE * (left > right ? left : right) / (q - p) : 0.0);
}
