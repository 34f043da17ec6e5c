/* What generated kernels stand on: C99, no global state, nothing on the heap. */

#include <math.h>
#include <stdlib.h>

#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

#if defined(_WIN32)
#define TEG_EXPORT __declspec(dllexport)
#else
#define TEG_EXPORT
#endif

/* As needed. */

/* x - y*floor(x/y): the remainder with the sign of y. */
static inline double teg_mod(double x, double y)
{
    return x - y * floor(x / y);
}

/* The smaller of two numbers, NaN if one is. */
static inline double teg_min(double x, double y)
{
    return x < y || x != x ? x : y;
}

/* The larger of two numbers, NaN if one is. */
static inline double teg_max(double x, double y)
{
    return x > y || x != x ? x : y;
}

/* x to an integer power, by squaring. */
static inline double teg_powi(double x, int n)
{
    double power = 1.0;
    unsigned left = n < 0 ? 0u - (unsigned)n : (unsigned)n;
    while (left) {
        if (left & 1u) power *= x;
        x *= x;
        left >>= 1;
    }
    return n < 0 ? 1.0 / power : power;
}

/* A break moved into [a, b]; a break that is NaN is absent and moves to a. */
static inline double teg_clamp(double x, double a, double b)
{
    return x > a ? (x < b ? x : b) : a;
}

/* Whether (p, q) is wide enough to be integrated over. */
static inline int teg_is_piece(double p, double q)
{
    const double left = fabs(p), right = fabs(q);
    return q - p > TEG_PIECE_EPS * (left > right ? left : right);
}

static inline void teg_fill(double *values, int n, double x)
{
    for (int i = 0; i < n; i++) values[i] = x;
}

/* Sink the root of a heap of n numbers to its place. */
static inline void teg_sink(double *heap, int root, int n)
{
    const double x = heap[root];
    for (int child; (child = 2 * root + 1) < n; root = child) {
        if (child + 1 < n && heap[child] < heap[child + 1]) child++;
        if (heap[child] <= x) break;
        heap[root] = heap[child];
    }
    heap[root] = x;
}

/* Sort without NaNs: insertion for few, a heap for many. */
static inline void teg_sort(double *t, int n)
{
    if (n <= 48) {
        for (int i = 1; i < n; i++) {
            const double x = t[i];
            int j = i;
            for (; j > 0 && t[j - 1] > x; j--) t[j] = t[j - 1];
            t[j] = x;
        }
        return;
    }
    for (int i = n / 2 - 1; i >= 0; i--) teg_sink(t, i, n);
    for (int i = n - 1; i > 0; i--) {
        const double x = t[0];
        t[0] = t[i];
        t[i] = x;
        teg_sink(t, 0, i);
    }
}

/* How coinciding surfaces are ordered in this run (+1 or -1), and whether any were met. */
typedef struct {
    int order;
    int tied;
} teg_context;

static inline int teg_tie(teg_context *ctx, double g, double scale, int r)
{
    if (fabs(g) <= TEG_TIE_EPS * scale && isfinite(g)) {
        ctx->tied = 1;
        return ctx->order > 0 ? r : !r;
    }
    return g > 0.0;
}

/* An interval of u in (0, 1) that waits for its turn; the longest queue is TEG_MAX_DEPTH + 1. */
typedef struct {
    double from, to;
    int depth;
} teg_interval;

/* One node of the Gauss-Kronrod pair (10, 21) on (-1, 1); constants of QUADPACK's qk21. */
typedef struct {
    double node, kronrod, gauss;
} teg_pair_node;

static const teg_pair_node teg_pair[21] = {
    {-0.995657163025808080735527280689003, 0.011694638867371874278064396062192, 0.0},
    {-0.973906528517171720077964012084452, 0.032558162307964727478818972459390, 0.066671344308688137593568809893332},
    {-0.930157491355708226001207180059508, 0.054755896574351996031381300244580, 0.0},
    {-0.865063366688984510732096688423493, 0.075039674810919952767043140916190, 0.149451349150580593145863396957696},
    {-0.780817726586416897063717578345042, 0.093125454583697605535065465083366, 0.0},
    {-0.679409568299024406234327365114874, 0.109387158802297641899210590325805, 0.219086362515982043995534934228163},
    {-0.562757134668604683339000099272694, 0.123491976262065851077958109585166, 0.0},
    {-0.433395394129247190799265943165784, 0.134709217311473325928054001771707, 0.269266719309996355091226921569469},
    {-0.294392862701460198131126603103866, 0.142775938577060080797094273138717, 0.0},
    {-0.148874338981631210884826001129720, 0.147739104901338491374841515972068, 0.295524224714752870173815619188769},
    {0.0, 0.149445554002916905664936468389821, 0.0},
    {0.148874338981631210884826001129720, 0.147739104901338491374841515972068, 0.295524224714752870173815619188769},
    {0.294392862701460198131126603103866, 0.142775938577060080797094273138717, 0.0},
    {0.433395394129247190799265943165784, 0.134709217311473325928054001771707, 0.269266719309996355091226921569469},
    {0.562757134668604683339000099272694, 0.123491976262065851077958109585166, 0.0},
    {0.679409568299024406234327365114874, 0.109387158802297641899210590325805, 0.219086362515982043995534934228163},
    {0.780817726586416897063717578345042, 0.093125454583697605535065465083366, 0.0},
    {0.865063366688984510732096688423493, 0.075039674810919952767043140916190, 0.149451349150580593145863396957696},
    {0.930157491355708226001207180059508, 0.054755896574351996031381300244580, 0.0},
    {0.973906528517171720077964012084452, 0.032558162307964727478818972459390, 0.066671344308688137593568809893332},
    {0.995657163025808080735527280689003, 0.011694638867371874278064396062192, 0.0},
};

/* Whether every value's Kronrod sum k is good enough; g is the Gauss sum, a the sum of |value|, whole a of the piece. */
static inline int teg_accepts(
    int n, const double *k, const double *g, const double *a, const double *whole, double tol)
{
    for (int j = 0; j < n; j++) {
        const double error = fabs(k[j] - g[j]);
        const double rounding = TEG_ROUNDING * a[j], wanted = tol * (whole[j] + TEG_ABSOLUTE_FLOOR);
        if (error > (wanted > rounding ? wanted : rounding) && isfinite(error)) return 0;
    }
    return 1;
}

/* The sign of g, as boxes know it: 1 if g > 0, 0 if not, 2 if g is NaN. */
static inline int teg_sign(double g)
{
    return isnan(g) ? 2 : g > 0.0;
}

/* A box of an isolation: its ends, and the signs of g there. */
typedef struct {
    double from, to;
    int left, right;
} teg_box;

/* Whether g changes its sign in a box. */
static inline int teg_changes(const teg_box *box)
{
    return box->left + box->right == 1;
}

/* The isolation of the roots of g, a dialogue: it asks for g and g' at `at`, and if for a TEG_BOX for their bounds over `box`.
   The boxes of a level and of the next one take turns in `boxes`; beyond the last level they are the undecided ones, joined. */
typedef struct {
    enum { TEG_DONE, TEG_LEFT, TEG_RIGHT, TEG_BOX, TEG_STEP } asks;
    int level, taken, count, next, steps, found, room;
    double at, value, slope, before, last, *roots;
    teg_box box, boxes[2][TEG_ISOLATE_WIDTH];
} teg_isolation;

/* Begin with the signs at the ends; there is room for so many roots. */
static void teg_isolate(teg_isolation *s, double lo, double hi, double *roots, int room)
{
    const int finite = isfinite(lo) && isfinite(hi);
    s->roots = roots;
    s->room = room;
    s->level = s->taken = s->count = s->next = 0;
    s->found = finite ? 0 : room + 1;
    s->box = (teg_box){lo < hi ? lo : hi, lo < hi ? hi : lo, 2, 2};
    s->asks = finite && lo != hi ? TEG_LEFT : TEG_DONE;
    s->at = s->box.from;
}

/* Ask for the next box, of this level or of the next one. */
static void teg_next_box(teg_isolation *s)
{
    if (s->taken == s->count) {
        s->level++;
        s->taken = 0;
        s->count = s->next;
        s->next = 0;
    }
    s->asks = TEG_DONE;
    if (s->taken == s->count || s->level > TEG_ISOLATE_DEPTH || s->found > s->room) return;
    s->box = s->boxes[s->level & 1][s->taken++];
    s->asks = TEG_BOX;
    s->at = 0.5 * (s->box.from + s->box.to);
}

static inline void teg_found(teg_isolation *s, double root)
{
    if (s->found < s->room) s->roots[s->found] = root;
    s->found++;
}

/* Put a box on the next level; too many boxes are as bad as too many roots. */
static inline void teg_put_box(teg_isolation *s, double from, double to, int left, int right)
{
    if (s->next < TEG_ISOLATE_WIDTH) s->boxes[(s->level + 1) & 1][s->next++] = (teg_box){from, to, left, right};
    else s->found = s->room + 1;
}

/* Halve a box, or leave it whole if there is no number inside; on the last level join it to its left neighbour. */
static void teg_halve(teg_isolation *s)
{
    const teg_box box = s->box;
    const int middle = teg_sign(s->value), last = s->level == TEG_ISOLATE_DEPTH;
    teg_box *const before = &s->boxes[(s->level + 1) & 1][s->next - (s->next > 0)];
    if (last && s->next > 0 && before->to == box.from) {
        before->to = box.to;
        before->right = box.right;
    } else if (last || s->at <= box.from || s->at >= box.to) {
        teg_put_box(s, box.from, box.to, box.left, box.right);
    } else {
        teg_put_box(s, box.from, s->at, box.left, middle);
        teg_put_box(s, s->at, box.to, middle, box.right);
    }
}

/* Whether a box is monotone, by the bounds over it. */
static inline int teg_is_monotone(const teg_box *box, const double *bounds)
{
    return (bounds[2] > 0.0 || bounds[3] < 0.0) && box->left != 2 && box->right != 2;
}

/* Whether a box has no root, by the bounds over it alone. */
static inline int teg_is_clear(const teg_box *box, const double *bounds)
{
    return !teg_changes(box) && (bounds[0] > 0.0 || bounds[1] < 0.0 || teg_is_monotone(box, bounds));
}

/* Whether a box has no root, by the bounds over it and g in its middle: the mean value theorem, g is constant, or not defined. */
static inline int teg_is_empty(const teg_box *box, double g, const double *bounds)
{
    const double left = fabs(bounds[2]), right = fabs(bounds[3]);
    const double reach = 0.5 * (box->to - box->from) * (left > right ? left : right);
    if (left == 0.0 && right == 0.0) return 1;
    if (teg_changes(box)) return 0;
    if (isfinite(left) && isfinite(right) && (g - reach > 0.0 || g + reach < 0.0)) return 1;
    return isnan(bounds[0]) && isnan(bounds[1]) && isnan(g);
}

/* A step of Newton's method, kept in a monotone box that shrinks around the root. Returns whether another one is needed. */
static inline int teg_step(teg_isolation *s)
{
    const double v = s->at, step = -s->value / s->slope, newton = v + step;
    if (s->value == 0.0) return 0;
    *((s->value > 0.0) == s->box.right ? &s->box.to : &s->box.from) = v;
    const int within = newton >= s->box.from && newton <= s->box.to;
    const int good = within && step != 0.0 && !(fabs(step) > 0.5 * s->before);
    s->at = good ? newton : 0.5 * (s->box.from + s->box.to);
    s->before = s->last;
    s->last = fabs(good ? step : s->at - v);
    return s->last > 0x1p-52 * fabs(s->at) && ++s->steps < TEG_ISOLATE_STEPS;
}

/* Take what was asked for (g, g', and of a TEG_BOX the bounds g-, g+, d-, d+), and ask for what is needed next. */
static void teg_answer(teg_isolation *s, const double *f)
{
    s->value = f[0];
    s->slope = f[1];
    switch (s->asks) {
    case TEG_LEFT:
        s->box.left = teg_sign(s->value);
        s->asks = TEG_RIGHT;
        s->at = s->box.to;
        return;
    case TEG_RIGHT:
        s->box.right = teg_sign(s->value);
        s->asks = TEG_BOX;
        s->at = 0.5 * (s->box.from + s->box.to);
        return;
    case TEG_BOX:
        if (!teg_is_monotone(&s->box, f + 2)) {
            if (!teg_is_empty(&s->box, s->value, f + 2)) teg_halve(s);
            break;
        }
        s->asks = TEG_STEP;
        s->steps = 0;
        s->before = s->last = INFINITY; /* fall through */
    default:
        if (teg_step(s)) return;
        teg_found(s, s->at);
    }
    teg_next_box(s);
}

/* The roots in order, then +inf; NaN if there are more than fit. */
static void teg_roots(teg_isolation *s)
{
    for (int i = 0; i < s->count && s->level > TEG_ISOLATE_DEPTH; i++) {
        const teg_box *const box = &s->boxes[s->level & 1][i];
        const int times = teg_changes(box) ? 1 : box->left != 2 && box->right != 2 ? 2 : 0;
        for (int k = 0; k < times; k++) teg_found(s, 0.5 * (box->from + box->to));
    }
    if (s->found > s->room) {
        teg_fill(s->roots, s->room, NAN);
        return;
    }
    teg_sort(s->roots, s->found);
    teg_fill(s->roots + s->found, s->room - s->found, INFINITY);
}

/* A rectangle of a location, that was halved so often: v between left and right, u between bottom and top. */
typedef struct {
    double left, right, bottom, top;
    int level;
} teg_rectangle;

/* The location of common zeros, a dialogue: it asks for the bounds of f and g over `here`. Rectangles are taken depth-first, so
   that few wait; `used` counts those of every level, and the kept ones leave their intervals of v in `from` and `to`. */
typedef struct {
    int overfull, count, kept, used[TEG_LOCATE_DEPTH + 1];
    teg_rectangle here, waiting[TEG_LOCATE_DEPTH + 1];
    double from[TEG_LOCATE_WIDTH], to[TEG_LOCATE_WIDTH];
} teg_location;

/* Let a rectangle wait for its turn, or give up where its level has too many. */
static inline void teg_put_rectangle(teg_location *s, teg_rectangle box)
{
    if (++s->used[box.level] > TEG_LOCATE_WIDTH) s->overfull = 1;
    else s->waiting[s->count++] = box;
}

/* Begin with the whole rectangle, if there is one. */
static void teg_locate(teg_location *s, double lo, double hi, double low, double high)
{
    const int finite = isfinite(lo) && isfinite(hi) && isfinite(low) && isfinite(high);
    const teg_rectangle whole = {
        lo < hi ? lo : hi, lo < hi ? hi : lo, low < high ? low : high, low < high ? high : low, 0};
    s->overfull = s->count = s->kept = 0;
    for (int i = 0; i <= TEG_LOCATE_DEPTH; i++) s->used[i] = 0;
    if (finite && lo != hi && low != high) teg_put_rectangle(s, whole);
}

/* Take the next rectangle, the leftmost and lowest that waits. Returns whether there is one. */
static inline int teg_next_rectangle(teg_location *s)
{
    if (s->overfull || s->count == 0) return 0;
    s->here = s->waiting[--s->count];
    return 1;
}

/* Drop, keep or halve a rectangle, by the bounds f-, f+, g-, g+ over it. */
static inline void teg_judge(teg_location *s, const double *f)
{
    const teg_rectangle box = s->here;
    teg_rectangle first = box, second = box;
    if (f[0] > 0.0 || f[1] < 0.0 || f[2] > 0.0 || f[3] < 0.0) return;
    if ((isnan(f[0]) && isnan(f[1])) || (isnan(f[2]) && isnan(f[3]))) return;
    if (box.level == TEG_LOCATE_DEPTH) {
        s->from[s->kept] = box.left;
        s->to[s->kept++] = box.right;
        return;
    }
    first.level = second.level = box.level + 1;
    if (box.level % 2 == 0) first.right = second.left = 0.5 * (box.left + box.right);
    else first.top = second.bottom = 0.5 * (box.bottom + box.top);
    teg_put_rectangle(s, second);
    teg_put_rectangle(s, first);
}

/* The middles of the joined intervals in order, then +inf; all +inf if there are more than fit. Both ends are sorted by
   themselves: an interval begins a new place where as many intervals ended before it as began. */
static void teg_places(teg_location *s, double *places, int room)
{
    int found = 0;
    if (s->overfull) s->kept = 0;
    teg_sort(s->from, s->kept);
    teg_sort(s->to, s->kept);
    for (int i = 0, first = 0; i < s->kept; i++) {
        if (i + 1 < s->kept && s->from[i + 1] <= s->to[i]) continue;
        if (found < room) places[found] = 0.5 * (s->from[first] + s->to[i]);
        found++;
        first = i + 1;
    }
    if (found > room) found = 0;
    teg_fill(places + found, room - found, INFINITY);
}
