/* What generated kernels stand on: C99, no global state, nothing on the heap. */

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

#if defined(_WIN32)
#define TEG_EXPORT __declspec(dllexport)
#else
#define TEG_EXPORT
#endif

#ifdef __GNUC__
#define TEG_INLINE static inline __attribute__((always_inline))
#define TEG_APART static __attribute__((noinline))
#else
#define TEG_INLINE static inline
#define TEG_APART static
#endif

/* A loop over eight numbers is worth vectors of eight, where a compiler would choose two of four. */
#if defined(__AVX512F__) && defined(__GNUC__) && !defined(__clang__)
#define TEG_EIGHT static __attribute__((noinline, target("prefer-vector-width=512")))
#else
#define TEG_EIGHT static
#endif

/* Where eight numbers are read at once, which takes longer across the end of a cache line. */
#ifdef __GNUC__
#define TEG_ALIGNED __attribute__((aligned(64)))
#else
#define TEG_ALIGNED
#endif

//: teg_floordiv
/* The integer quotient, rounded down. */
static inline int64_t teg_floordiv(int64_t a, int64_t b)
{
    const int64_t q = a / b;
    return q * b != a && (a < 0) != (b < 0) ? q - 1 : q;
}

//: teg_ceil
/* The least integer that is not below a number of -1 or more. */
static inline int64_t teg_ceil(double x)
{
    const int64_t below = (int64_t)x;
    return below + ((double)below < x);
}

//: teg_narrow
/* Leaves out iterations at both ends of a range: those where a straight line through the first and the last of n numbers is negative. */
static inline void teg_narrow(int n, const double *first, const double *last, int64_t *lo, int64_t *hi)
{
    const int64_t start = *lo, stop = *hi;
    const double steps = (double)(stop - 1 - start), near = 1e-6 + 1e-14 * steps;
    for (int m = 0; m < n; m++) {
        const double fall = first[m] - last[m], place = steps * (first[m] / fall);
        if (first[m] < 0.0 && last[m] < 0.0) *hi = *lo;
        else if (!(place >= 0.0 && place <= steps && fall - fall == 0.0)) continue;
        else if (first[m] < 0.0 && start + teg_ceil(place - near) > *lo) *lo = start + teg_ceil(place - near);
        else if (last[m] < 0.0 && start + (int64_t)(place + near) + 1 < *hi) *hi = start + (int64_t)(place + near) + 1;
    }
}

//: teg_cover
/* Leaves the iterations of a range where straight lines through the first and the last of n numbers are positive. Most lines are, at both
   ends of what those before them left. */
static inline void teg_cover(int n, const double *first, const double *last, int64_t *lo, int64_t *hi)
{
    const int64_t start = *lo, stop = *hi;
    const double steps = (double)(stop - 1 - start), near = 1e-6 + 1e-14 * steps, part = steps > 0.0 ? 1.0 / steps : 0.0;
    double least = 0.0, most = steps;
    for (int m = 0; m < n; m++) {
        const double g = first[m], h = last[m], slope = (h - g) * part;
        if (g + least * slope > 0.0 && g + most * slope > 0.0) continue;
        const double fall = g - h, place = steps * (g / fall);
        if (!(place >= 0.0 && place <= steps && fall - fall == 0.0)) *hi = *lo;
        else if (h > 0.0) *lo = start + (int64_t)(place + near) + 1 > *lo ? start + (int64_t)(place + near) + 1 : *lo;
        else if (g > 0.0) *hi = start + teg_ceil(place - near) < *hi ? start + teg_ceil(place - near) : *hi;
        else *hi = *lo;
        if (*lo >= *hi) return;
        least = (double)(*lo - start), most = (double)(*hi - 1 - start);
    }
}

//: teg_prefetch
/* Asks for the numbers from the first to the last of `count` entries, if they lie together. */
static inline void teg_prefetch(const double *first, const double *last, int64_t count)
{
#ifdef __GNUC__
    if (last - first < 8 * count)
        for (; first <= last; first += 8) __builtin_prefetch(first);
#else
    (void)first, (void)last, (void)count;
#endif
}

//: teg_mod
/* x - y*floor(x/y): the remainder with the sign of y. */
static inline double teg_mod(double x, double y)
{
    return x - y * floor(x / y);
}

//: teg_min
/* The smaller of two numbers, NaN if one is. */
static inline double teg_min(double x, double y)
{
    return x < y || x != x ? x : y;
}

//: teg_max
/* The larger of two numbers, NaN if one is. */
static inline double teg_max(double x, double y)
{
    return x > y || x != x ? x : y;
}

//: teg_powi
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

//: teg_clamp
/* A break moved into [a, b]; a break that is NaN is absent and moves to a. */
static inline double teg_clamp(double x, double a, double b)
{
    return x > a ? (x < b ? x : b) : a;
}

//: teg_is_piece
/* Whether (p, q) is wide enough to be integrated over. */
static inline int teg_is_piece(double p, double q)
{
    const double left = fabs(p), right = fabs(q);
    return q - p > TEG_PIECE_EPS * (left > right ? left : right) || (isinf(q - p) && p < q);
}

//: teg_fill
static inline void teg_fill(double *values, int n, double x)
{
    for (int i = 0; i < n; i++) values[i] = x;
}

//: teg_sink
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

//: teg_sort
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

//: teg_breaks
/* The ends of the pieces of (a, b): a is the first number, n breaks stand behind it. Those inside are sorted, b follows, then
   those that are not inside. Returns the number of pieces. */
static inline int teg_breaks(double *ends, int n, double b)
{
    const double a = ends[0];
    int pieces = 1;
    for (int i = 1; i <= n; i++) {
        const double t = ends[i];
        ends[i] = ends[pieces];
        ends[pieces] = t;
        pieces += t > a && t < b;
    }
    teg_sort(ends + 1, pieces - 1);
    if (pieces <= n) ends[n + 1] = ends[pieces];
    ends[pieces] = b;
    return pieces;
}

//: teg_neighbours
/* Whether the piece (p, q) of n breaks, behind b the others, has a neighbour: 1 at its first end, 2 at its last, 3 at both. */
static inline int teg_neighbours(const double *ends, int n, int pieces, double p, double q)
{
    const double size = fabs(p) > fabs(q) ? fabs(p) : fabs(q);
    const double least = fmax(TEG_AT_END * (q - p), TEG_PIECE_EPS * size), most = TEG_NEIGHBOUR * (q - p);
    int found = 0;
    for (int i = 1; i <= n + 1 && isfinite(q - p); i++) {
        const double left = p - ends[i], right = ends[i] - q;
        if (i != pieces) found |= (left > least && left < most) + 2 * (right > least && right < most);
    }
    return found;
}
