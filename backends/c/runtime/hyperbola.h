/* Hyperbolas on the unit square: moments and borders. */

//: teg_near_side
/* Whether a function with these values at the corners is so small along a side, compared with the others, that it may be 0. */
static inline int teg_near_side(double f0, double f1, double f2, double f3)
{
    const double a = fabs(f0) + fabs(f1), b = fabs(f1) + fabs(f2), c = fabs(f2) + fabs(f3), d = fabs(f3) + fabs(f0);
    const double ab = a < b ? a : b, cd = c < d ? c : d;
    return (ab < cd ? ab : cd) <= TEG_NEAR_SIDE * (a + c);
}

//: teg_settle
/* The ends of sides along which g is 0 to rounding, bits; they become 0. None if all corners are. Rare, so out of the way. */
#ifdef __GNUC__
__attribute__((noinline))
#endif
static int teg_settle(teg_context *ctx, double *f, const double *scale)
{
    int zero = 0;
    for (int i = 0; i < 4; i++) zero |= (fabs(f[i]) <= TEG_TIE_EPS * scale[i]) << i;
    const int sides = zero & (zero >> 1 | zero << 3), on = (sides | sides << 1 | sides >> 3) & 15;
    if (on == 0 || on == 15) return 0;
    ctx->tied = 1;
    for (int i = 0; i < 4; i++)
        if (on >> i & 1) f[i] = 0.0;
    return on;
}

//: teg_above
/* The corners at which g > 0, bits, and others; -1 if one is not finite. */
static inline int teg_above(double f0, double f1, double f2, double f3, int also)
{
    if (!((f0 - f0) + (f1 - f1) + (f2 - f2) + (f3 - f3) == 0.0)) return -1;
    return (f0 > 0.0) | (f1 > 0.0) << 1 | (f2 > 0.0) << 2 | (f3 > 0.0) << 3 | also;
}

//: teg_if
/* x if it holds, else 0, without a branch. */
static inline double teg_if(int holds, double x)
{
    union {
        double x;
        uint64_t bits;
    } pun = {x};
    pun.bits &= -(uint64_t)(holds != 0);
    return pun.x;
}

//: teg_cross
/* ab - cd, to a rounding or two, however much cancels. */
static inline double teg_cross(double a, double b, double c, double d)
{
    const double p = a * b, q = c * d;
#ifdef FP_FAST_FMA
    return (p - q) + (fma(a, b, -p) - fma(c, d, -q));
#else
    double rest[2];
    for (int i = 0; i < 2; i++) {
        const double u = i ? c : a, v = i ? d : b, high_u = 134217729.0 * u - (134217729.0 * u - u), low_u = u - high_u;
        const double high_v = 134217729.0 * v - (134217729.0 * v - v), low_v = v - high_v;
        rest[i] = ((high_u * high_v - (i ? q : p)) + high_u * low_v + low_u * high_v) + low_u * low_v;
    }
    return (p - q) + (rest[0] - rest[1]);
#endif
}

//: teg_branch
/* A branch of a curve on the unit square, from side to side: the middle of its chord and half of what it changes by, z, what
   dw/(1 + z*w) is multiplied with, and the slopes at both ends, whose ratio is that of 1 + z and 1 - z, or its inverse. */
typedef struct {
    double x, y, half_x, half_y, z, rate, low, high;
} teg_branch;

//: teg_curve
/* The curve g = a + b*u + c*v + d*u*v = 0, where it crosses the side from (1, 0) to (1, 1) and what of that side is beyond, its
   branches, and whether it crosses itself in the square, at (u, v). */
typedef struct {
    double a, b, c, d, cut, beyond, u, v;
    int count, crosses;
    teg_branch branches[2];
} teg_curve;

//: teg_follow
/* The branch that begins on side i and ends on side j, given where g is 0 on the sides, and its slopes there along the sides and
   across them. */
static inline void teg_follow(teg_branch *s, const double *at, const double *along, const double *other, double d, int i, int j)
{
    static const double X[4] = {0.0, 1.0, 1.0, 0.0}, Y[4] = {0.0, 0.0, 1.0, 1.0};
    static const double OVER[4] = {1.0, 0.0, -1.0, 0.0}, UP[4] = {0.0, 1.0, 0.0, -1.0};
    const double x0 = X[i] + OVER[i] * at[i], y0 = Y[i] + UP[i] * at[i], x1 = X[j] + OVER[j] * at[j], y1 = Y[j] + UP[j] * at[j];
    const double up0 = i & 1 ? along[i] : other[i], up1 = j & 1 ? along[j] : other[j];
    const double across0 = i & 1 ? other[i] : along[i], across1 = j & 1 ? other[j] : along[j];
    const double up = 0.5 * (up0 + up1), across = 0.5 * (across0 + across1);
    const int steep = fabs(across) >= fabs(up);
    s->half_x = 0.5 * (x1 - x0);
    s->half_y = 0.5 * (y1 - y0);
    s->x = 0.5 * (x0 + x1);
    s->y = 0.5 * (y0 + y1);
    const double below = steep ? -across : up, rate = (steep ? s->half_y : s->half_x) / (below == 0.0 ? 1.0 : below);
    s->z = d * rate;
    s->rate = fabs(rate);
    s->low = fabs(steep ? across0 : up0);
    s->high = fabs(steep ? across1 : up1);
}

//: teg_turn
/* The logarithm of the ratio of the slopes at both ends of a branch, the larger one by the smaller one. */
static inline double teg_turn(double low, double high)
{
    const double ratio = low > high ? low / high : high / low;
    return log(ratio < TEG_LARGEST_RATIO ? ratio : TEG_LARGEST_RATIO);
}

//: teg_trace
/* The curve of g with values f at the corners, at some of which, `above`, it is positive; `turn` is NaN if it is not known. */
static inline void teg_trace(teg_curve *curve, double f0, double f1, double f2, double f3, double turn, int above)
{
    static const signed char FIRST[16] = {0, 0, 0, 1, 1, 0, 0, 2, 2, 0, 0, 1, 1, 0, 0, 0};
    static const signed char LAST[16] = {0, 3, 1, 3, 2, 0, 2, 3, 3, 2, 0, 2, 3, 1, 3, 0};
    const double most = 0.25 * fabs(f0) + 0.25 * fabs(f1) + 0.25 * fabs(f2) + 0.25 * fabs(f3);
    const int fits = most >= TEG_SMALLEST && most <= 1.0 / TEG_SMALLEST;
    double g[4] = {f0, f1, f2, f3}, at[4], other[4];
    for (int i = 0; !fits && i < 4; i++) g[i] /= most;
    /* minus the product of both slopes, the same all along the curve */
    turn = isnan(turn) ? teg_cross(g[0], g[2], g[1], g[3]) : fits ? turn : turn / most / most;
    const double along[4] = {g[1] - g[0], g[2] - g[1], g[2] - g[3], g[3] - g[0]};
    for (int i = 0; i < 4; i++) {
        at[i] = g[i] / (i < 2 ? -along[i] : along[i]);
        other[i] = -turn / along[i];
    }
    curve->a = g[0];
    curve->b = along[0];
    curve->c = along[3];
    curve->d = (g[0] - g[1]) + (g[2] - g[3]);
    curve->cut = at[1];
    curve->beyond = g[2] / along[1];
    curve->crosses = 0;
    curve->count = above == 5 || above == 10 ? 2 : 1;
    if (curve->count == 1) {
        teg_follow(curve->branches, at, along, other, curve->d, FIRST[above], LAST[above]);
    } else {
        const int odd = turn > 0.0; /* corners 1 and 3 are cut off, else 0 and 2 */
        teg_follow(curve->branches, at, along, other, curve->d, odd ? 0 : 3, odd ? 1 : 0);
        teg_follow(curve->branches + 1, at, along, other, curve->d, odd ? 2 : 1, odd ? 3 : 2);
    }
    if (fabs(turn) <= 4.0 * TEG_SADDLE * fabs(curve->d) * (fits ? most : 1.0) && curve->d != 0.0) {
        double size = 0.0;
        for (int i = 0; i < 4; i++) size += 0.5 * fabs(g[i] + g[(i + 1) & 3]);
        curve->u = -curve->c / curve->d;
        curve->v = -curve->b / curve->d;
        const int inside = curve->u >= 0.0 && curve->u <= 1.0 && curve->v >= 0.0 && curve->v <= 1.0;
        curve->crosses = inside && fabs(turn) <= TEG_SADDLE * size * fabs(curve->d);
    }
    if (!fits) {
        curve->a *= most;
        curve->b *= most;
        curve->c *= most;
        curve->d *= most;
        for (int i = 0; i < curve->count; i++) curve->branches[i].rate /= most;
    }
}
