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
