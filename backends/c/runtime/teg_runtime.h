/* What generated kernels stand on: C99, no global state, nothing on the heap. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

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
#else
#define TEG_INLINE static inline
#endif

/* As needed. */

/* The integer quotient, rounded down. */
static inline int64_t teg_floordiv(int64_t a, int64_t b)
{
    const int64_t q = a / b;
    return q * b != a && (a < 0) != (b < 0) ? q - 1 : q;
}

/* Into how many chunks a loop is cut whose iterations cost so many operations, and add to so many numbers. */
static inline long teg_chunks(int64_t iterations, int64_t cost, int64_t size)
{
    const double total = (double)iterations * (double)cost / (TEG_LEAST + 4.0 * (double)size);
    int64_t chunks = total < TEG_CHUNKS ? (int64_t)total : TEG_CHUNKS;
    if (size > 0 && chunks > TEG_COPIES / size) chunks = TEG_COPIES / size;
    return chunks < 1 || iterations < 1 ? 1 : chunks < iterations ? (long)chunks : (long)iterations;
}

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
    return q - p > TEG_PIECE_EPS * (left > right ? left : right) || (isinf(q - p) && p < q);
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

/* What can stop a call: the thread that called asks `poll`, which tells after how much more work to ask again, or 0 to stop. */
typedef struct {
    long (*poll)(void *data);
    void *data;
    int stopped;
} teg_watch;

/* How much work a thread may do before it asks. */
typedef struct {
    teg_watch *watch;
    int caller;
    long left;
} teg_pace;

/* Whether the call was stopped; sets how much work may be done before this is called again. */
static int teg_ask(teg_pace *pace)
{
    teg_watch *const watch = pace->watch;
    int stopped;
    pace->left = 0;
#ifdef _OPENMP
#pragma omp atomic read
#endif
    stopped = watch->stopped;
    if (stopped) return 1;
    pace->left = pace->caller && watch->poll ? watch->poll(watch->data) : 16;
    if (pace->left > 0) return 0;
#ifdef _OPENMP
#pragma omp atomic write
#endif
    watch->stopped = 1;
    return 1;
}

/* Count a piece of work, before it is begun. Returns whether it is to be left out, as all the rest: the call was stopped. */
static inline int teg_stopped(teg_pace *pace)
{
    return --pace->left < 0 && teg_ask(pace);
}

/* Wait until no thread works any more, and keep asking. */
static inline void teg_wait(teg_pace *pace, int *working)
{
    int others = 0;
#ifdef _OPENMP
#pragma omp atomic
#endif
    --*working;
    if (!pace->caller || !pace->watch->poll) return;
    do {
#ifdef _OPENMP
#pragma omp atomic read
#endif
        others = *working;
    } while (others > 0 && !teg_ask(pace));
}

/* How coinciding surfaces are ordered in this run (+1 or -1), whether any were met, a tolerance was missed, and a search had too
   little room; the evaluations, if they are counted, and those of adaptive integrals; what may stop it. */
typedef struct {
    int order, tied, missed, crowded;
    long evaluations, work;
    teg_pace *pace;
} teg_context;

static inline int teg_tie(teg_context *ctx, double g, double scale, int r)
{
    if (fabs(g) <= TEG_TIE_EPS * scale && isfinite(g)) {
        ctx->tied = 1;
        return ctx->order > 0 ? r : !r;
    }
    return g > 0.0;
}

/* Numbers side by side. */
#ifdef __GNUC__
typedef double __attribute__((vector_size(16), aligned(8), may_alias)) teg_lanes_2;
#else
typedef double teg_lanes_2;
#endif

/* Numbers side by side. */
#ifdef __GNUC__
typedef double __attribute__((vector_size(32), aligned(8), may_alias)) teg_lanes_4;
#else
typedef double teg_lanes_4;
#endif

/* Numbers side by side. */
#ifdef __GNUC__
typedef double __attribute__((vector_size(64), aligned(8), may_alias)) teg_lanes_8;
#else
typedef double teg_lanes_8;
#endif

/* Flags side by side: all bits of a number, or none. */
#ifdef __GNUC__
typedef long long __attribute__((vector_size(64), aligned(8), may_alias)) teg_flags_8;
#else
typedef int teg_flags_8;
#endif

/* Of numbers side by side those of x where g > 0, else those of y. */
static inline void teg_choose_8(teg_lanes_8 *chosen, const teg_lanes_8 *g, const teg_lanes_8 *x, const teg_lanes_8 *y)
{
    const teg_flags_8 above = (teg_flags_8)(*g > 0.0);
#ifdef __GNUC__
    *chosen = (teg_lanes_8)((above & (teg_flags_8)*x) | (~above & (teg_flags_8)*y));
#else
    *chosen = above ? *x : *y;
#endif
}

static inline double teg_total_2(const teg_lanes_2 *lanes)
{
#ifdef __GNUC__
    const teg_lanes_2 x = *lanes;
    return x[0] + x[1];
#else
    return *lanes;
#endif
}

static inline double teg_total_4(const teg_lanes_4 *lanes)
{
#ifdef __GNUC__
    const teg_lanes_2 *const halves = (const teg_lanes_2 *)lanes, x = halves[0] + halves[1];
    return x[0] + x[1];
#else
    return *lanes;
#endif
}

static inline double teg_total_8(const teg_lanes_8 *lanes)
{
#ifdef __GNUC__
    const teg_lanes_4 *const halves = (const teg_lanes_4 *)lanes, x = halves[0] + halves[1];
    const teg_lanes_2 *const quarters = (const teg_lanes_2 *)&x, y = quarters[0] + quarters[1];
    return y[0] + y[1];
#else
    return *lanes;
#endif
}

/* (c + a*u) + b*v > 0, or >= 0 if it is closed. */
typedef struct {
    double a, b, c;
    int closed;
} teg_half_plane;

/* A polygon cut by a half-plane; the new number of its corners, for which there is room. */
static inline int teg_clip(int n, double *px, double *py, const teg_half_plane *g, int room)
{
    double d[TEG_CORNERS], qx[TEG_CORNERS], qy[TEG_CORNERS];
    int kept = 0, m = 0;
    for (int i = 0; i < n; i++) {
        d[i] = g->c + g->a * px[i] + g->b * py[i];
        kept += d[i] >= 0.0;
    }
    if (kept == n || kept == 0 || n + n / 2 > room) return kept ? n : 0; /* a convex one never has so many */
    for (int i = 0, last = n - 1; i < n; last = i++) {
        const double p = d[last], q = d[i];
        if ((p > 0.0 && q < 0.0) || (p < 0.0 && q > 0.0)) {
            const int in = p > 0.0 ? last : i, out = p > 0.0 ? i : last;
            const double t = d[in] / (d[in] - d[out]);
            qx[m] = px[in] + t * (px[out] - px[in]);
            qy[m] = py[in] + t * (py[out] - py[in]);
            m++;
        }
        qx[m] = px[i];
        qy[m] = py[i];
        m += q >= 0.0;
    }
    for (int i = 0; i < m; i++) {
        px[i] = qx[i];
        py[i] = qy[i];
    }
    return m;
}

/* Whether no half-plane fails on the box from (0, 0) to (width, height): 0 if one does, -1 if that is not known; and their least
   values. */
static inline int teg_meets(int n, const teg_half_plane *g, double width, double height, double *least)
{
    int known = isfinite(width) && isfinite(height);
    for (int i = 0; i < n; i++) {
        const double u = g[i].a * width, v = g[i].b * height;
        const double most = g[i].c + (u <= 0.0 ? 0.0 : u) + (v <= 0.0 ? 0.0 : v);
        least[i] = g[i].c + (u >= 0.0 ? 0.0 : u) + (v >= 0.0 ? 0.0 : v);
        if (most <= 0.0 && !(g[i].closed && least[i] >= 0.0)) return 0;
        known &= isfinite(most - least[i]);
    }
    return known ? 1 : -1;
}

/* That box cut by half-planes with these least values: the number of its corners, 0 if nothing is left. */
static inline int teg_clipped_box(
    int n, const teg_half_plane *g, double width, double height, const double *least, double *px, double *py)
{
    int corners = 4;
    px[0] = px[3] = py[0] = py[1] = 0.0;
    px[1] = px[2] = width;
    py[2] = py[3] = height;
    for (int i = 0; i < n; i++)
        if (least[i] < 0.0) corners = teg_clip(corners, px, py, g + i, 2 * (4 + n));
    return corners;
}

/* The same, or -1 if that is not known. */
static inline int teg_polygon(int n, const teg_half_plane *g, double width, double height, double *px, double *py)
{
    double least[TEG_HALF_PLANES];
    const int meets = teg_meets(n, g, width, height, least);
    return meets > 0 ? teg_clipped_box(n, g, width, height, least, px, py) : meets;
}

/* As teg_clip, a polygon whose vertices carry two numbers more; the new ones are exactly on a side of the box. */
static inline int teg_clip_carrying(int n, double *const *p, const teg_half_plane *g, int room, int side)
{
    double d[TEG_CORNERS], q[4][TEG_CORNERS];
    int kept = 0, m = 0;
    for (int i = 0; i < n; i++) {
        d[i] = g->c + g->a * p[0][i] + g->b * p[1][i];
        kept += d[i] >= 0.0;
    }
    if (kept == n || kept == 0 || n + n / 2 > room) return kept ? n : 0;
    for (int i = 0, last = n - 1; i < n; last = i++) {
        if ((d[last] > 0.0 && d[i] < 0.0) || (d[last] < 0.0 && d[i] > 0.0)) {
            const int in = d[last] > 0.0 ? last : i, out = d[last] > 0.0 ? i : last;
            const double t = d[in] / (d[in] - d[out]);
            for (int j = 0; j < 4; j++) q[j][m] = p[j][in] + t * (p[j][out] - p[j][in]);
            if (side) q[g->a == 0.0][m] = -g->c * (g->a + g->b);
            m++;
        }
        for (int j = 0; j < 4; j++) q[j][m] = p[j][i];
        m += d[i] >= 0.0;
    }
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < m; i++) p[j][i] = q[j][i];
    return m;
}

/* A triangle cut by the box, and by half-planes from number 3 on, with its barycentric coordinates. */
static inline int teg_thin(
    int n, const teg_half_plane *g, double width, double height, const double (*at)[2], double *const *p)
{
    const double su = width < 0.0 ? -1.0 : 1.0, sv = height < 0.0 ? -1.0 : 1.0;
    const teg_half_plane sides[4] = {
        {su, 0.0, 0.0, 0}, {-su, 0.0, su * width, 0}, {0.0, sv, 0.0, 0}, {0.0, -sv, sv * height, 0}};
    const double turn =
        (at[1][0] - at[0][0]) * (at[2][1] - at[0][1]) - (at[2][0] - at[0][0]) * (at[1][1] - at[0][1]);
    const int second = turn * su * sv < 0.0 ? 2 : 1, from[3] = {0, second, 3 - second};
    int corners = 3;
    for (int k = 0; k < 3; k++) {
        p[0][k] = at[from[k]][0];
        p[1][k] = at[from[k]][1];
        p[2][k] = from[k] == 1;
        p[3][k] = from[k] == 2;
    }
    for (int i = 0; i < 4; i++) corners = teg_clip_carrying(corners, p, sides + i, 2 * (4 + n), 1);
    for (int i = 3; i < n; i++) corners = teg_clip_carrying(corners, p, g + i, 2 * (4 + n), 0);
    return corners;
}

/* As teg_polygon, of a triangle's half-planes, and maybe others; of a thin one with its barycentric coordinates at the corners. */
static inline int teg_triangle(
    int n, const teg_half_plane *g, double width, double height, const double (*at)[2], double across, double *const *p, int *thin)
{
    double least[TEG_HALF_PLANES], swing = 0.0;
    const int meets = teg_meets(n, g, width, height, least);
    if (meets <= 0) return meets;
    if (!isfinite(across)) return -1;
    if (across <= 0.0) return 0;
    for (int i = 0; i < 3; i++) {
        const double change = fabs(g[i].a * width) + fabs(g[i].b * height);
        if (change > swing) swing = change;
    }
    *thin = across < TEG_THIN * swing;
    return *thin ? teg_thin(n, g, width, height, at, p) : teg_clipped_box(n, g, width, height, least, p[0], p[1]);
}

/* Up to seven nodes without a weight, so that nodes can be taken by eights. */
static inline void teg_pad(int n, double *x, double *y, double *w)
{
    for (int i = n; i % 8; i++) {
        x[i] = x[0];
        y[i] = y[0];
        w[i] = 0.0;
    }
}

/* One node that counts for a whole polygon. */
static inline int teg_fan_0(int corners, const double *px, const double *py, double *x, double *y, double *w)
{
    if (corners < 3) return 0;
    double twice = 0.0;
    for (int k = 1; k + 1 < corners; k++)
        twice += (px[k] - px[0]) * (py[k + 1] - py[0]) - (px[k + 1] - px[0]) * (py[k] - py[0]);
    x[0] = px[0];
    y[0] = py[0];
    w[0] = 0.5 * twice;
    return 1;
}

/* The nodes that teg_fan_2 has on a rectangle from the origin, eight numbers at a time. */
static inline int teg_rectangle_2(double width, double height, double *x, double *y, double *w)
{
    static const double at[3][8] = {
        {0.5, 1.0, 0.5, 0.5, 0.0, 0.5, 0.5, 0.5},
        {0.0, 0.5, 0.5, 1.0, 0.5, 0.0, 0.0, 0.0},
        {1.0 / 6.0, 1.0 / 6.0, 1.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0, 0.0, 0.0, 0.0}};
    const double area = width * height;
    for (int i = 0; i < 8; i++) {
        x[i] = width * at[0][i];
        y[i] = height * at[1][i];
        w[i] = area * at[2][i];
    }
    return 5;
}

/* The middles of the sides of the triangles of a fan, which integrate degree 2; how many they are. */
static inline int teg_fan_2(int corners, const double *px, const double *py, double *x, double *y, double *w)
{
    if (corners < 3) return 0;
    if (corners == 4 && px[0] == 0.0 && px[3] == 0.0 && px[1] == px[2] && py[0] == 0.0 && py[1] == 0.0 && py[2] == py[3] &&
        isfinite(px[2] * py[2]))
        return teg_rectangle_2(px[2], py[2], x, y, w);
    double before = 0.0;
    int n = 0;
    for (int k = 1; k + 1 < corners; k++) {
        const double ux = px[k] - px[0], uy = py[k] - py[0], vx = px[k + 1] - px[0], vy = py[k + 1] - py[0];
        const double third = (ux * vy - vx * uy) * (1.0 / 6.0);
        x[n] = px[0] + 0.5 * ux;
        y[n] = py[0] + 0.5 * uy;
        w[n++] = before + third;
        x[n] = px[k] + 0.5 * (px[k + 1] - px[k]);
        y[n] = py[k] + 0.5 * (py[k + 1] - py[k]);
        w[n++] = third;
        before = third;
    }
    x[n] = px[0] + 0.5 * (px[corners - 1] - px[0]);
    y[n] = py[0] + 0.5 * (py[corners - 1] - py[0]);
    w[n++] = before;
    teg_pad(n, x, y, w);
    return n;
}

/* The nodes of a rule on the triangles of a fan; how many they are. */
static inline int teg_fan(
    int corners, const double *px, const double *py, int nodes, const double (*rule)[3], double *x, double *y, double *w)
{
    int n = 0;
    for (int k = 1; k + 1 < corners; k++) {
        const double ux = px[k] - px[0], uy = py[k] - py[0], vx = px[k + 1] - px[0], vy = py[k + 1] - py[0];
        const double area = 0.5 * (ux * vy - vx * uy);
        for (int i = 0; i < nodes; i++, n++) {
            x[n] = px[0] + rule[i][0] * ux + rule[i][1] * vx;
            y[n] = py[0] + rule[i][0] * uy + rule[i][1] * vy;
            w[n] = area * rule[i][2];
        }
    }
    teg_pad(n, x, y, w);
    return n;
}

/* An affine function, relative to a number, at nodes, by eights. */
static inline void teg_affine(int nodes, const teg_half_plane *g, double scale, const double *x, const double *y, double *at)
{
    const double a = g->a, b = g->b, c = g->c;
    for (int i = 0; i < nodes; i += 8)
        for (int k = i; k < i + 8; k++) at[k] = (c + a * x[k] + b * y[k]) * scale;
}

/* What nodes of teg_fan_0, teg_fan_2 and teg_fan have of what the corners of the polygon have. */
static inline void teg_carry_0(int corners, const double *p, double *at)
{
    for (int i = 0; i < 8; i++) at[i] = corners > 2 ? p[0] : 0.0;
}

static inline void teg_carry_2(int corners, const double *p, double *at)
{
    int n = 0;
    for (int k = 1; k + 1 < corners; k++) {
        at[n++] = p[0] + 0.5 * (p[k] - p[0]);
        at[n++] = p[k] + 0.5 * (p[k + 1] - p[k]);
    }
    if (corners < 3) return;
    at[n++] = p[0] + 0.5 * (p[corners - 1] - p[0]);
    for (int i = n; i % 8; i++) at[i] = at[0];
}

static inline void teg_carry(int corners, const double *p, int nodes, const double (*rule)[3], double *at)
{
    int n = 0;
    for (int k = 1; k + 1 < corners; k++)
        for (int i = 0; i < nodes; i++) at[n++] = p[0] + rule[i][0] * (p[k] - p[0]) + rule[i][1] * (p[k + 1] - p[0]);
    for (int i = n; i % 8; i++) at[i] = at[0];
}

/* What half-lines leave of (0, 1): whether one excludes all of it, and whether one is not a number. */
typedef struct {
    double from, to;
    int outside, undefined;
} teg_interval_cut;

static inline void teg_cut(teg_interval_cut *cut, double first, double last, int closed)
{
    const double root = first / (first - last);
    cut->outside |= first <= 0.0 && last <= 0.0 && !(closed && first == 0.0 && last == 0.0);
    cut->undefined |= !isfinite(first - last);
    if (first < 0.0 && last > 0.0 && root > cut->from) cut->from = root;
    if (first > 0.0 && last < 0.0 && root < cut->to) cut->to = root;
}

static inline int teg_is_near(double first, double last, double size)
{
    return fabs(first) <= TEG_NEARLY * size && fabs(last) <= TEG_NEARLY * size && isfinite(first - last);
}

static inline int teg_ties(teg_context *ctx, teg_interval_cut *cut, double first, double last, double scale, int holds)
{
    if (!(fabs(first) <= TEG_TIE_EPS * scale && fabs(last) <= TEG_TIE_EPS * scale)) return 0;
    ctx->tied = 1;
    cut->outside |= ctx->order > 0 ? !holds : holds;
    return 1;
}

/* An interval of u in (0, 1) that waits for its turn; the longest queue is TEG_MAX_DEPTH + 1. */
typedef struct {
    double from, to;
    int depth;
} teg_interval;

/* A node of Gauss-Legendre on (-1, 1): its weight and its weights in the six null rules. */
typedef struct {
    double node, rule[7];
} teg_node;

/* The errors of n values from their sums: 8 numbers each, the sum, the six null rules, and the sum of sizes. The error of a
   value is written in the place of its first null rule. Whether all are small enough, or not finite. */
static inline int teg_assess(int n, double *sums, const double *whole, double tol, int power)
{
    int good = 1;
    for (int j = 0; j < n; j++, sums += 8) {
        const double e1 = fabs(sums[1]), e2 = fabs(sums[2]), e3 = fabs(sums[3]), e4 = fabs(sums[4]);
        const double e5 = fabs(sums[5]), e6 = fabs(sums[6]);
        const double a = e1 > e2 ? e1 : e2, b = e3 > e4 ? e3 : e4, c = e5 > e6 ? e5 : e6;
        const double tail = b > c && b > a ? b : a;
        const double last = a / b, before = b / c, slowing = last / before;
        double ratio = last > before ? last * (slowing * slowing * slowing) : before;
        if (ratio > 0.25) ratio = (15.0 * ratio - 2.0) / 7.0;
        double error = 4.0 * tail;
        if (tail <= TEG_NOISE * sums[7]) error = 0.0;
        else if (ratio < 1.0 && last == last) for (int k = 0; k < power; k++) error *= ratio;
        const double rounding = TEG_ROUNDING * sums[7], wanted = tol * (whole[j] + TEG_ABSOLUTE_FLOOR);
        if (error > (wanted > rounding ? wanted : rounding) && isfinite(error)) good = 0;
        sums[1] = error;
    }
    return good;
}

/* Where u in (0, 1) is on a piece (p, q), and how fast it goes: centre + radius*phi(start + step*u), phi by kind. */
typedef struct {
    enum { TEG_LINE, TEG_CUBIC, TEG_SQUARE, TEG_SINE, TEG_COSH, TEG_SINH, TEG_EXP, TEG_POWER, TEG_TAIL } kind;
    int at_p, at_q, both, number;
    double p, q, centre, radius, start, step, nearest;
} teg_substitution;

/* Whether the errors of a piece add up to more than one of them may be. */
static inline int teg_overspent(int n, const double *spent, const double *whole, double tol)
{
    for (int j = 0; j < n; j++) {
        const double rounding = TEG_ROUNDING * whole[j], wanted = tol * (whole[j] + TEG_ABSOLUTE_FLOOR);
        if (spent[j] > TEG_SPENT * (wanted > rounding ? wanted : rounding)) return 1;
    }
    return 0;
}

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

/* Whether all errors are finite. */
static inline int teg_settled(int n, const double *sums)
{
    for (int j = 0; j < n; j++) if (!isfinite(sums[8 * j + 1])) return 0;
    return 1;
}

/* Whether a box of this length may hold more of a value than its error may be. */
static inline int teg_matters(int n, const double *sizes, double length, const double *sums, const double *above, double tol)
{
    if (!isfinite(length)) return 1;
    for (int j = 0; j < n; j++) {
        const double rounding = TEG_ROUNDING * sums[8 * j + 7], wanted = tol * (above[j] + TEG_ABSOLUTE_FLOOR);
        if (!(sizes[j] * length <= (wanted > rounding ? wanted : rounding))) return 1;
    }
    return 0;
}

/* Whether one of n sharp values can be large in a gap, or in all of an interval (gap -1), and was not seen to be at the nodes, (nodes, n).
   Bounds are the n upper ones, then the lower ones; an infinite one counts in gaps that are inside only. */
static inline int teg_unseen(int n, const double *bounds, const double *seen, int nodes, int gap, int inside)
{
    for (int i = 0; i < n; i++) {
        const double upper = bounds[i], lower = bounds[n + i];
        double s = NAN;
        if (gap < 0) for (int k = 0; k < nodes; k++) s = fmin(s, seen[n * k + i]);
        else s = fmax(gap > 0 ? seen[n * (gap - 1) + i] : NAN, gap < nodes ? seen[n * gap + i] : NAN);
        if (gap >= 0 && !inside && isinf(upper)) continue;
        if (upper > TEG_UNSEEN * fmax(s, TEG_FAINT) || upper > TEG_HIDDEN * fmax(lower, TEG_FAINT)) return 1;
    }
    return 0;
}

/* What rounding does to an integral over (p, q), relative to that of |values|: theirs, and that of the ends. */
static inline double teg_rounding(double p, double q)
{
    const double left = fabs(p), right = fabs(q);
    return 0.5 * TEG_ROUNDING + (isfinite(q - p) ? TEG_EDGE * (left > right ? left : right) / (q - p) : 0.0);
}

/* The straight one, or the one with flat ends. */
static inline void teg_straight(teg_substitution *s, double p, double q, int cubic)
{
    s->kind = cubic ? TEG_CUBIC : TEG_LINE;
    s->at_p = s->at_q = -1;
    s->both = s->number = 0;
    s->p = s->centre = p;
    s->q = q;
    s->radius = q - p;
    s->start = 0.0;
    s->step = 1.0;
    s->nearest = TEG_NEAR;
}

/* A tail, if the piece is one. */
static inline void teg_tail(teg_substitution *s, double scale)
{
    if (isfinite(s->q - s->p)) return;
    const int left = isinf(s->p);
    s->kind = TEG_TAIL;
    s->centre = left ? s->q : s->p;
    s->radius = left ? -scale : scale;
    s->start = left ? 1.0 : 0.0;
    s->step = left ? -1.0 : 1.0;
}

/* Where on a piece its conditions are decided. */
static inline double teg_inside(double p, double q, double scale)
{
    if (isinf(p)) return q - scale * ((1.0 - TEG_INSIDE) / TEG_INSIDE);
    return isinf(q) ? p + scale * (TEG_INSIDE / (1.0 - TEG_INSIDE)) : p + TEG_INSIDE * (q - p);
}

/* The sum of the distances of y from the foci of the ellipses around (p, q), scaled to (-1, 1). */
static inline double teg_nearness(double y, double p, double q)
{
    return (fabs(y - p) + fabs(y - q)) * (2.0 / (q - p));
}

/* The zeros of c0 + c1*w + c2*w*w, w from the base, as a bend of a kind ('r'oot, 'p'ole, 'e'nd): if it is nearer than what was
   found before, it gives the substitution. */
static void teg_bend(teg_substitution *s, int kind, int when, double base, double c0, double c1, double c2)
{
    const int number = s->number++;
    const double p = s->p - base, q = s->q - base, length = q - p, width = fabs(p) > fabs(q) ? fabs(p) : fabs(q);
    const int linear = fabs(c2) * width * width <= 1e-13 * (fabs(c1) * width + fabs(c0));
    if (!when || !isfinite(c0) || !isfinite(c1) || !isfinite(c2) || !isfinite(length)) return;
    if (linear && fabs(c1) * width <= 1e-13 * fabs(c0)) return;
    const double square = c1 * c1 - 4.0 * c0 * c2, larger = -0.5 * (c1 + copysign(sqrt(fabs(square)), c1)), end = 1e-9 * length;
    const int paired = !linear && square < 0.0;
    double one = linear ? -c0 / c1 : c0 / larger, other = linear ? one : larger / c2;
    const double to_one = teg_nearness(one, p, q), to_other = teg_nearness(other, p, q);
    const int alone = !paired && (linear || to_one > TEG_FAR || to_other > TEG_FAR || !isfinite(to_one + to_other));
    if (alone && !(to_one <= to_other)) one = other;
    if (alone) other = one;
    const double below = one < other ? one : other, above = one < other ? other : one;
    double m = paired ? -0.5 * c1 / c2 : 0.5 * (below + above);
    double h = paired ? sqrt(fabs(square)) * fabs(0.5 / c2) : 0.5 * (above - below);
    if (!alone && !(h >= (paired ? 1e-100 : 1e-12) * length)) return;
    const double to_below = teg_nearness(below, p, q), to_above = teg_nearness(above, p, q);
    const double near = paired ? (hypot(m - p, h) + hypot(m - q, h)) * (2.0 / length) : to_below < to_above ? to_below : to_above;
    const int at_p = !paired && (fabs(below - p) <= end || fabs(above - p) <= end);
    const int at_q = !paired && (fabs(below - q) <= end || fabs(above - q) <= end);
    if (kind == 'p') {
        const double y = to_below <= to_above ? below : above;
        const double margin = TEG_POLE * (fabs(s->p) > fabs(s->q) ? fabs(s->p) : fabs(s->q));
        if (!paired && !(y < p - margin || y > q + margin)) return;
    } else if (!paired && ((below > p + end && below < q - end) || (above > p + end && above < q - end))) {
        return; /* the substitution would leave out what is beyond a zero */
    } else if (at_p != at_q) {
        if (at_p ? s->at_q >= 0 : s->at_p >= 0) s->both = 1;
        if (at_p) s->at_p = number;
        if (at_q) s->at_q = number;
    }
    if (!(near < s->nearest)) return;
    s->nearest = near;
    const double centre = 0.5 * (p + q);
    const double at_left = fabs(above - p) <= end ? above : below, at_right = fabs(below - q) <= end ? below : above;
    const double left = at_p ? fmin(0.0, p - at_left) : 0.0; /* zeros at the ends do not stay inside */
    const double right = at_q ? fmax(0.0, q - at_right) : 0.0;
    double sign = m <= centre ? 1.0 : -1.0, from, to;
    if (paired) {
        s->kind = TEG_SINH;
        sign = 1.0;
        from = asinh((p - m) / h);
        to = asinh((q - m) / h);
    } else if (kind == 'p') {
        s->kind = TEG_EXP;
        m = to_below <= to_above ? below : above;
        sign = m <= centre ? 1.0 : -1.0;
        h = 1.0;
        from = log(sign * (p - m));
        to = log(sign * (q - m));
    } else if (kind == 'e' && at_p != at_q) {
        s->kind = TEG_POWER;
        m = at_p ? p : q;
        sign = at_p ? 1.0 : -1.0;
        h = length;
        from = at_p ? 0.0 : 1.0;
        to = at_p ? 1.0 : 0.0;
    } else if (alone) {
        s->kind = TEG_SQUARE;
        m += left + right;
        h = 1.0;
        from = sqrt(fmax(0.0, sign * (p - m)));
        to = sqrt(fmax(0.0, sign * (q - m)));
    } else if (fabs(centre - m) <= h) {
        s->kind = TEG_SINE;
        m += 0.5 * (left + right);
        h += 0.5 * (right - left);
        sign = 1.0;
        from = asin(fmax(-1.0, fmin(1.0, (p - m) / h)));
        to = asin(fmax(-1.0, fmin(1.0, (q - m) / h)));
    } else {
        s->kind = TEG_COSH;
        m += left + right;
        from = acosh(fmax(1.0, sign * (p - m) / h));
        to = acosh(fmax(1.0, sign * (q - m) / h));
    }
    s->centre = base + m;
    s->radius = sign * h;
    s->start = from;
    s->step = to - from;
}

/* Two bends at the two ends: flat ends. */
static inline void teg_bent(teg_substitution *s)
{
    if (s->both) teg_straight(s, s->p, s->q, 1);
}

/* A pole D = 0 and a piece, at whose ends D is `low` and `high`: it counts there or not, and is clear of the piece or met on it.
   `size` is how large the terms of D are. */
typedef struct {
    enum { TEG_NONE, TEG_CLEAR, TEG_MET } kind;
    double low, high, least, size;
} teg_pole;

static inline teg_pole teg_pole_at(int when, double p, double q, double base, double c0, double c1)
{
    const double first = p - base, last = q - base, low = c0 + c1 * first, high = c0 + c1 * last;
    const double least = fabs(low) < fabs(high) ? fabs(low) : fabs(high), left = fabs(p), right = fabs(q);
    const double size = fabs(c0) + fabs(c1) * (fabs(first) > fabs(last) ? fabs(first) : fabs(last));
    teg_pole pole = {TEG_NONE, low, high, least, size};
    if (!when || !isfinite(c0) || !isfinite(c1)) return pole;
    pole.kind = low * high > 0.0 && least > TEG_POLE * (left > right ? left : right) * fabs(c1) ? TEG_CLEAR : TEG_MET;
    return pole;
}

/* What is lost of an integral over the power of D, relative to that of |values|. */
static inline double teg_pole_loss(int power, const teg_pole *pole)
{
    return pole->kind == TEG_CLEAR ? power * TEG_EDGE * pole->size / pole->least : 0.0;
}

/* Add the values at a node to three sums each: plain, by the first null rule, and of the sizes. */
static inline void teg_meet(int n, const double *f, double weight, double null, double *sizes)
{
    for (int j = 0; j < n; j++) {
        sizes[3 * j] += weight * f[j];
        sizes[3 * j + 1] += null * f[j];
        sizes[3 * j + 2] += weight * fabs(f[j]);
    }
}

/* Values that have a pole on the piece become infinite; whether there are any. */
static inline int teg_is_endless(int n, const double *sizes, double *sum)
{
    int found = 0;
    for (int j = 0; j < n; j++) {
        if (!(fabs(sizes[3 * j + 1]) > TEG_RESIDUE * sizes[3 * j + 2])) continue;
        sum[j] += copysign(INFINITY, sizes[3 * j]);
        found = 1;
    }
    return found;
}

/* Whether a function with these values at the corners is so small along a side, compared with the others, that it may be 0. */
static inline int teg_near_side(double f0, double f1, double f2, double f3)
{
    const double a = fabs(f0) + fabs(f1), b = fabs(f1) + fabs(f2), c = fabs(f2) + fabs(f3), d = fabs(f3) + fabs(f0);
    const double ab = a < b ? a : b, cd = c < d ? c : d;
    return (ab < cd ? ab : cd) <= TEG_NEAR_SIDE * (a + c);
}

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

/* The corners at which g > 0, bits, and others; -1 if one is not finite. */
static inline int teg_above(double f0, double f1, double f2, double f3, int also)
{
    if (!((f0 - f0) + (f1 - f1) + (f2 - f2) + (f3 - f3) == 0.0)) return -1;
    return (f0 > 0.0) | (f1 > 0.0) << 1 | (f2 > 0.0) << 2 | (f3 > 0.0) << 3 | also;
}

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

/* A branch of a curve on the unit square, from side to side: the middle of its chord and half of what it changes by, z, what
   dw/(1 + z*w) is multiplied with, and the slopes at both ends, whose ratio is that of 1 + z and 1 - z, or its inverse. */
typedef struct {
    double x, y, half_x, half_y, z, rate, low, high;
} teg_branch;

/* The curve g = 0: slopes b + d*v and c + d*u, where it crosses the side from (1, 0) to (1, 1), its branches, and whether it
   crosses itself in the square, at (u, v). */
typedef struct {
    double b, c, d, cut, u, v;
    int count, crosses;
    teg_branch branches[2];
} teg_curve;

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

/* The logarithm of the ratio of the slopes at both ends of a branch, the larger one by the smaller one. */
static inline double teg_turn(double low, double high)
{
    const double ratio = low > high ? low / high : high / low;
    return log(ratio < TEG_LARGEST_RATIO ? ratio : TEG_LARGEST_RATIO);
}

/* The curve of g with values f at the corners, at some of which, `above`, it is positive. */
static inline void teg_trace(teg_curve *curve, double f0, double f1, double f2, double f3, int above)
{
    static const signed char FIRST[16] = {0, 0, 0, 1, 1, 0, 0, 2, 2, 0, 0, 1, 1, 0, 0, 0};
    static const signed char LAST[16] = {0, 3, 1, 3, 2, 0, 2, 3, 3, 2, 0, 2, 3, 1, 3, 0};
    const double most = 0.25 * fabs(f0) + 0.25 * fabs(f1) + 0.25 * fabs(f2) + 0.25 * fabs(f3);
    const int fits = most >= TEG_SMALLEST && most <= 1.0 / TEG_SMALLEST;
    double g[4] = {f0, f1, f2, f3}, at[4], other[4];
    for (int i = 0; !fits && i < 4; i++) g[i] /= most;
    const double turn = teg_cross(g[0], g[2], g[1], g[3]); /* minus the product of both slopes, the same all along the curve */
    const double along[4] = {g[1] - g[0], g[2] - g[1], g[2] - g[3], g[3] - g[0]};
    for (int i = 0; i < 4; i++) {
        at[i] = g[i] / (i < 2 ? -along[i] : along[i]);
        other[i] = -turn / along[i];
    }
    curve->b = along[0];
    curve->c = along[3];
    curve->d = (g[0] - g[1]) + (g[2] - g[3]);
    curve->cut = at[1];
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
        curve->b *= most;
        curve->c *= most;
        curve->d *= most;
        for (int i = 0; i < curve->count; i++) curve->branches[i].rate /= most;
    }
}

/* The place of u; dv/du is written to `slope`. */
static double teg_place(const teg_substitution *s, double u, double *slope)
{
    const double t = s->start + s->step * u;
    double place, rate;
    switch (s->kind) {
    case TEG_CUBIC: place = t * t * (3.0 - 2.0 * t); rate = 6.0 * t * (1.0 - t); break;
    case TEG_SQUARE: place = t * t; rate = 2.0 * t; break;
    case TEG_SINE: place = sin(t); rate = cos(t); break;
    case TEG_COSH: place = cosh(t); rate = sinh(t); break;
    case TEG_SINH: place = sinh(t); rate = cosh(t); break;
    case TEG_EXP: place = rate = exp(t); break;
    case TEG_POWER: place = t * t * t * t * t * t; rate = 6.0 * (t * t * t * t * t); break;
    case TEG_TAIL: place = t / (1.0 - t); rate = 1.0 / ((1.0 - t) * (1.0 - t)); break;
    default: place = t; rate = 1.0; break;
    }
    *slope = s->radius * s->step * rate;
    place = s->centre + s->radius * place;
    if (!(place > s->p)) return nextafter(s->p, s->q);
    return place < s->q ? place : nextafter(s->q, s->p);
}

/* The sign of g, as boxes know it: 1 if g > 0, 0 if not, 2 if g is NaN. */
static inline int teg_sign(double g)
{
    return isnan(g) ? 2 : g > 0.0;
}

/* A box of an isolation: its ends, the signs of g there, and those of its slope. */
typedef struct {
    double from, to;
    int left, right, down, up, level;
} teg_box;

/* Whether g changes its sign in a box, and whether its slope does. */
static inline int teg_changes(const teg_box *box)
{
    return box->left + box->right == 1;
}

static inline int teg_turns(const teg_box *box)
{
    return box->down + box->up == 1;
}

/* The isolation of the roots of g, a dialogue: it asks for g, g' and g" at `at`, and for a TEG_BOX or a TEG_TOUCH also for
   what is known over (from, to). Boxes are taken from left to right, so that few wait; `used` counts those of every level.
   `lost` are the undecided boxes that were met last, joined. */
typedef struct {
    enum { TEG_DONE, TEG_LEFT, TEG_RIGHT, TEG_BOX, TEG_STEP, TEG_TURN, TEG_TOUCH } asks;
    int count, steps, found, room, width, refused, crowded, missed, used[TEG_ISOLATE_DEPTH + 1];
    double at, from, to, before, last, limit, *roots, *errors;
    teg_box box, lost, second, waiting[TEG_ISOLATE_DEPTH + 2];
} teg_isolation;

/* Begin with the signs at the ends; there is room for so many roots, and so many boxes on a level. */
static void teg_isolate(
    teg_isolation *s, double lo, double hi, double *roots, double *errors, int room, int width, double tol)
{
    const int finite = isfinite(lo) && isfinite(hi);
    s->roots = roots;
    s->errors = errors;
    s->room = room;
    s->width = width;
    s->limit = tol * fabs(hi - lo);
    s->count = s->found = s->crowded = s->missed = 0;
    s->refused = !finite;
    s->lost.level = s->second.level = -1;
    for (int i = 0; i <= TEG_ISOLATE_DEPTH; i++) s->used[i] = 0;
    s->box = (teg_box){lo < hi ? lo : hi, lo < hi ? hi : lo, 2, 2, 2, 2, 0};
    s->asks = finite && lo != hi ? TEG_LEFT : TEG_DONE;
    s->at = s->box.from;
}

/* Ask for what is known over the next box. */
static inline void teg_open_box(teg_isolation *s)
{
    s->asks = TEG_BOX;
    s->from = s->box.from;
    s->to = s->box.to;
    s->at = 0.5 * (s->box.from + s->box.to);
}

/* Take the leftmost box that waits, if there is one. */
static void teg_next_box(teg_isolation *s)
{
    s->asks = TEG_DONE;
    if (s->count == 0 || s->crowded) return;
    s->box = s->waiting[--s->count];
    teg_open_box(s);
}

/* Let a box wait; too many boxes are as bad as too many roots. */
static inline void teg_put_box(teg_isolation *s, teg_box box)
{
    if (++s->used[box.level] > s->width) s->crowded = 1;
    else s->waiting[s->count++] = box;
}

static inline void teg_note_root(teg_isolation *s, double root, double error)
{
    if (s->found == s->room) {
        s->crowded = 1;
        return;
    }
    s->missed |= error > s->limit;
    s->roots[s->found] = root;
    if (s->errors) s->errors[s->found] = error;
    s->found++;
}

/* The roots of the undecided boxes that were met last: one where g changes its sign, else two. */
static void teg_give_lost(teg_isolation *s)
{
    const teg_box lost = s->lost;
    if (lost.level < 0) return;
    s->lost.level = -1;
    const int times = teg_changes(&lost) ? 1 : lost.left != 2 && lost.right != 2 ? 2 : 0;
    for (int k = 0; k < times; k++) teg_note_root(s, 0.5 * (lost.from + lost.to), 0.5 * (lost.to - lost.from));
}

static void teg_found(teg_isolation *s, double root, double error)
{
    teg_give_lost(s);
    teg_note_root(s, root, error);
}

/* Give up on a box; it is joined to its left neighbour, if that is undecided as well. */
static void teg_lose(teg_isolation *s)
{
    if (s->lost.level >= 0 && s->lost.to == s->box.from) {
        s->lost.to = s->box.to;
        s->lost.right = s->box.right;
    } else {
        teg_give_lost(s);
        s->lost = s->box;
    }
}

/* Halve a box at `at`, or leave it whole if there is no number inside. */
static void teg_halve(teg_isolation *s, double value, double slope)
{
    teg_box left = s->box, right = s->box;
    left.level = right.level = s->box.level + 1;
    if (s->at <= left.from || s->at >= left.to) {
        teg_put_box(s, left);
        return;
    }
    left.to = right.from = s->at;
    left.right = right.left = teg_sign(value);
    left.up = right.down = teg_sign(slope);
    teg_put_box(s, right);
    teg_put_box(s, left);
}

/* Whether a box is monotone, by the bounds over it. */
static inline int teg_is_monotone(const teg_box *box, const double *bounds)
{
    return (bounds[2] > 0.0 || bounds[3] < 0.0) && box->left != 2 && box->right != 2;
}

/* Whether g is convex or concave over a box. */
static inline int teg_is_bent(const teg_box *box, const double *bounds)
{
    const int known = box->left != 2 && box->right != 2 && box->down != 2 && box->up != 2;
    return (bounds[4] > 0.0 || bounds[5] < 0.0) && known;
}

/* Whether a box has no root, by the bounds over it alone: g is constant, not 0, monotone, or bent without a turn towards 0. */
static inline int teg_is_clear(const teg_box *box, const double *bounds)
{
    if (bounds[2] == 0.0 && bounds[3] == 0.0) return 1;
    if (teg_changes(box)) return 0;
    if (bounds[0] > 0.0 || bounds[1] < 0.0 || teg_is_monotone(box, bounds)) return 1;
    return teg_is_bent(box, bounds) && !(teg_turns(box) && box->left == (bounds[4] > 0.0));
}

/* Whether a box has no root, by the bounds over it and g in its middle: the mean value theorem, or g is not defined. */
static inline int teg_is_empty(const teg_box *box, double g, const double *bounds)
{
    const double left = fabs(bounds[2]), right = fabs(bounds[3]);
    const double reach = 0.5 * (box->to - box->from) * (left > right ? left : right);
    if (teg_changes(box)) return 0;
    if (isfinite(left) && isfinite(right) && (g - reach > 0.0 || g + reach < 0.0)) return 1;
    return isnan(bounds[0]) && isnan(bounds[1]) && isnan(g);
}

/* Whether g cannot be told from 0 on a box: g, g', g" in its middle, then the bounds, then the noise. */
static inline int teg_is_blurred(const teg_box *box, const double *f)
{
    const double h = 0.5 * (box->to - box->from), down = fabs(f[7]), up = fabs(f[8]);
    return fabs(f[0]) + h * fabs(f[1]) + 0.5 * h * h * (down > up ? down : up) <= f[9] && isfinite(f[9]);
}

/* A step of Newton's method for the zero of a function that is > 0 at the right end where `right` says so, kept in a box that
   shrinks around the zero. Returns whether another one is needed. */
static inline int teg_step(teg_isolation *s, double value, double slope, int right)
{
    const double v = s->at, step = -value / slope, newton = v + step;
    if (value == 0.0) return 0;
    *((value > 0.0) == right ? &s->box.to : &s->box.from) = v;
    const int within = newton >= s->box.from && newton <= s->box.to;
    const int good = within && step != 0.0 && !(fabs(step) > 0.5 * s->before);
    s->at = good ? newton : 0.5 * (s->box.from + s->box.to);
    s->before = s->last;
    s->last = fabs(good ? step : s->at - v);
    return s->last > 0x1p-52 * fabs(s->at) && ++s->steps < TEG_ISOLATE_STEPS;
}

/* Begin Newton's method in the middle of the box. */
static inline void teg_seek(teg_isolation *s, int asks)
{
    s->asks = asks;
    s->at = 0.5 * (s->box.from + s->box.to);
    s->steps = 0;
    s->before = s->last = INFINITY;
}

/* A step towards the root in the box, given g and g' at `at`; at its end the other root of a box that turned, or the next box. */
static void teg_approach(teg_isolation *s, const double *f)
{
    if (teg_step(s, f[0], f[1], s->box.right)) return;
    teg_found(s, s->at, 0.0);
    if (s->second.level < 0) {
        teg_next_box(s);
        return;
    }
    s->box = s->second;
    s->second.level = -1;
    teg_seek(s, TEG_STEP);
}

/* A step towards the place where g turns; at its end that is to be looked at. */
static void teg_near_turn(teg_isolation *s, const double *f)
{
    if (teg_step(s, f[1], f[2], s->box.up)) return;
    s->asks = TEG_TOUCH;
    s->from = s->to = s->at;
}

/* What becomes of a box whose bounds do not clear it, by what is known in its middle. */
static void teg_judge_box(teg_isolation *s, const double *f)
{
    const int monotone = teg_is_monotone(&s->box, f + 3), bent = teg_is_bent(&s->box, f + 3);
    if (teg_changes(&s->box) && (monotone || bent)) {
        teg_seek(s, TEG_STEP);
        teg_approach(s, f);
        return;
    }
    if (!teg_is_empty(&s->box, f[0], f + 3)) {
        if (bent) {
            s->second = s->box;
            teg_seek(s, TEG_TURN);
            teg_near_turn(s, f);
            return;
        }
        if (s->box.level == TEG_ISOLATE_DEPTH || teg_is_blurred(&s->box, f)) teg_lose(s);
        else teg_halve(s, f[0], f[1]);
    }
    teg_next_box(s);
}

/* What becomes of a box that turns at `at`, of which all is known there: two roots, one twice, or none. */
static void teg_judge_turn(teg_isolation *s, const double *f)
{
    s->box = s->second;
    s->second.level = -1;
    if (fabs(f[0]) <= f[9] && isfinite(f[9])) {
        for (int k = 0; k < 2; k++) teg_found(s, s->at, sqrt(2.0 * f[9] / fabs(f[2])));
    } else if ((f[0] > 0.0) != s->box.left) {
        s->second = s->box;
        s->box.to = s->second.from = s->at;
        s->box.right = s->second.left = f[0] > 0.0;
        teg_seek(s, TEG_STEP);
        return;
    }
    teg_next_box(s);
}

/* Take what was asked for (g, g', g", and of a TEG_BOX or a TEG_TOUCH the bounds g-, g+, d-, d+, c-, c+ and the noise), and
   ask for what is needed next. */
static void teg_answer(teg_isolation *s, const double *f)
{
    switch (s->asks) {
    case TEG_LEFT:
        s->box.left = teg_sign(f[0]);
        s->box.down = teg_sign(f[1]);
        s->asks = TEG_RIGHT;
        s->at = s->box.to;
        return;
    case TEG_RIGHT:
        s->box.right = teg_sign(f[0]);
        s->box.up = teg_sign(f[1]);
        teg_open_box(s);
        return;
    case TEG_BOX:
        teg_judge_box(s, f);
        return;
    case TEG_TURN:
        teg_near_turn(s, f);
        return;
    case TEG_TOUCH:
        teg_judge_turn(s, f);
        return;
    default:
        teg_approach(s, f);
    }
}

/* The roots in order, then +inf, and their errors; NaN if there are more than fit. */
static void teg_roots(teg_isolation *s, teg_context *ctx)
{
    if (!s->refused && !s->crowded) teg_give_lost(s);
    if (s->refused || s->crowded) {
        ctx->crowded |= s->crowded;
        teg_fill(s->roots, s->room, NAN);
        if (s->errors) teg_fill(s->errors, s->room, NAN);
        return;
    }
    ctx->missed |= s->missed;
    teg_fill(s->roots + s->found, s->room - s->found, INFINITY);
    if (s->errors) teg_fill(s->errors + s->found, s->room - s->found, 0.0);
}

/* The location of common zeros of f and g, a dialogue: it asks for their bounds over `here`, a TEG_RECTANGLE of this level or a
   point. The rectangles that are left of a level, by their corners in parts of the whole, and those of the next one take turns in
   `across` and `up`; `zeros` are those known to be alone in a rectangle. */
typedef struct {
    enum { TEG_RECTANGLE, TEG_MIDDLE, TEG_NEWTON } asks;
    int slopes, level, number, taken, left, examined, found, steps, times[2], last, useless[2], useful[2];
    double lo, low, extent, height, wide, tall, v, u, half, rise, bounds[8];
    struct {
        double left, right, bottom, top;
    } here;
    double across[2][TEG_LOCATE_WIDTH], up[2][TEG_LOCATE_WIDTH], zeros[TEG_LOCATE_ZEROS];
} teg_location;

/* Begin with the whole rectangle, if there is one; are the slopes bounded too? */
static void teg_locate(teg_location *s, int slopes, double lo, double hi, double low, double high)
{
    const int finite = isfinite(lo) && isfinite(hi) && isfinite(low) && isfinite(high);
    s->asks = TEG_RECTANGLE;
    s->slopes = slopes;
    s->lo = lo < hi ? lo : hi;
    s->low = low < high ? low : high;
    s->extent = fabs(hi - lo);
    s->height = fabs(high - low);
    s->wide = s->tall = 1.0;
    s->half = s->rise = 0.0;
    s->level = s->taken = s->left = s->found = s->steps = 0;
    s->times[0] = s->times[1] = s->useless[0] = s->useless[1] = s->useful[0] = s->useful[1] = 0;
    s->last = -1;
    s->examined = s->number = finite && lo != hi && low != high;
}

/* The corner of a rectangle of this level: one half of what was left of the level before. */
static inline void teg_corner(teg_location *s, int i)
{
    const int before = (s->level - 1) & 1;
    s->v = s->u = 0.0;
    if (s->level == 0) return;
    s->v = s->across[before][i / 2];
    s->u = s->up[before][i / 2];
    if (i % 2 == 0) return;
    if (s->last == 0) s->v += s->wide;
    else s->u += s->tall;
}

/* In which direction the rectangles that are left are halved, 0 for v and 1 for u: by turns, but in one again that is of use
   while the other is not. */
static inline int teg_direction(teg_location *s)
{
    if (s->last >= 0) {
        s->useless[s->last] = 50 * s->left >= 49 * s->number;
        s->useful[s->last] = 20 * s->left <= 11 * s->number;
    }
    int along = s->times[0] > s->times[1];
    if (s->useless[1] && s->useful[0]) along = 0;
    else if (s->useless[0] && s->useful[1]) along = 1;
    return s->times[along] < TEG_LOCATE_HALVINGS ? along : 1 - along;
}

/* A level was examined: is there to be another one? */
static inline int teg_next_level(teg_location *s)
{
    const int twice = 2 * s->left, finest = s->times[0] == TEG_LOCATE_HALVINGS && s->times[1] == TEG_LOCATE_HALVINGS;
    if (twice == 0 || twice > TEG_LOCATE_WIDTH || s->examined + twice > TEG_LOCATE_MOST || finest) return 0;
    if (s->found > TEG_LOCATE_ZEROS) return 0;
    s->last = teg_direction(s);
    s->times[s->last]++;
    s->level++;
    s->number = twice;
    s->examined += twice;
    s->taken = s->left = 0;
    if (s->last == 0) s->wide *= 0.5;
    else s->tall *= 0.5;
    return 1;
}

/* Take the next rectangle. Returns whether there is anything to be asked. */
static inline int teg_next_rectangle(teg_location *s)
{
    if (s->asks != TEG_RECTANGLE) return 1;
    if (s->taken == s->number && !teg_next_level(s)) return 0;
    teg_corner(s, s->taken);
    s->here.left = s->lo + s->extent * s->v;
    s->here.right = s->lo + s->extent * (s->v + s->wide);
    s->here.bottom = s->low + s->height * s->u;
    s->here.top = s->low + s->height * (s->u + s->tall);
    return 1;
}

/* Ask for the values at a point. */
static inline void teg_ask_at(teg_location *s, double v, double u)
{
    s->here.left = s->here.right = v;
    s->here.bottom = s->here.top = u;
}

/* Whether bounds f-, f+, g-, g+ leave no common zero. */
static inline int teg_excluded(const double *f)
{
    return f[0] > 0.0 || f[1] < 0.0 || f[2] > 0.0 || f[3] < 0.0 || (isnan(f[0]) && isnan(f[1])) || (isnan(f[2]) && isnan(f[3]));
}

/* What bounds of slopes over a rectangle with half the sides h and k, and the values f and g in its middle, say of common zeros:
   -1, there is none; 1, there is one, and Newton's method finds it; 0, nothing. */
static int teg_krawczyk(const double *bounds, double f, double g, double h, double k)
{
    double size[4], middle[4], radius[4];
    for (int i = 0; i < 4; i++) {
        const double least = bounds[2 * i], most = bounds[2 * i + 1];
        size[i] = fmax(fabs(least), fabs(most));
        if (isnan(least) || isnan(most)) size[i] = NAN;
        middle[i] = 0.5 * (least + most);
        radius[i] = 0.5 * (most - least);
    }
    if (fabs(f) > size[0] * h + size[1] * k || fabs(g) > size[2] * h + size[3] * k) return -1;
    const double det = fabs(middle[0] * middle[3] - middle[1] * middle[2]);
    const double a = middle[0] / det, b = middle[1] / det, c = middle[2] / det, d = middle[3] / det;
    const double v = fabs(d * f - b * g), u = fabs(a * g - c * f);
    const double across = (fabs(d) * radius[0] + fabs(b) * radius[2]) * h + (fabs(d) * radius[1] + fabs(b) * radius[3]) * k;
    const double up = (fabs(c) * radius[0] + fabs(a) * radius[2]) * h + (fabs(c) * radius[1] + fabs(a) * radius[3]) * k;
    if (v > h + across || u > k + up) return -1;
    return across <= 0.25 * h && up <= 0.25 * k && v + across < h && u + up < k;
}

/* The rectangle that was asked for is done with; it may be left over. */
static inline void teg_done(teg_location *s, int left)
{
    if (left) {
        s->across[s->level & 1][s->left] = s->v;
        s->up[s->level & 1][s->left++] = s->u;
    }
    s->taken++;
    s->asks = TEG_RECTANGLE;
}

/* A step of Newton's method from `here`, by f, g and their slopes there. */
static inline void teg_newton(teg_location *s, const double *f)
{
    const double det = f[4] * f[10] - f[6] * f[8];
    const double v = s->here.left - (f[10] * f[0] - f[6] * f[2]) / det, u = s->here.bottom - (f[4] * f[2] - f[8] * f[0]) / det;
    if (++s->steps < TEG_LOCATE_STEPS) {
        teg_ask_at(s, v, u);
        return;
    }
    if (s->found < TEG_LOCATE_ZEROS) s->zeros[s->found] = v;
    s->found++;
    teg_done(s, 0);
}

/* Drop, keep or settle a rectangle, by the bounds of f, of g and of their slopes over `here`. */
static inline void teg_judge(teg_location *s, const double *f)
{
    const double h = 0.5 * (s->here.right - s->here.left), k = 0.5 * (s->here.top - s->here.bottom);
    if (s->asks == TEG_RECTANGLE && (teg_excluded(f) || !s->slopes)) {
        teg_done(s, !teg_excluded(f));
    } else if (s->asks == TEG_RECTANGLE) {
        for (int i = 0; i < 8; i++) s->bounds[i] = f[4 + i];
        s->half = h;
        s->rise = k;
        s->asks = TEG_MIDDLE;
        teg_ask_at(s, 0.5 * (s->here.left + s->here.right), 0.5 * (s->here.bottom + s->here.top));
    } else if (s->asks == TEG_MIDDLE) {
        const int known = teg_krawczyk(s->bounds, f[0], f[2], s->half, s->rise);
        if (known != 1) {
            teg_done(s, known == 0);
            return;
        }
        s->asks = TEG_NEWTON;
        s->steps = 0;
        teg_newton(s, f);
    } else {
        teg_newton(s, f);
    }
}

/* Put a place behind the others, if there is room. */
static inline int teg_put_place(double *places, int room, int found, double place)
{
    if (found < room) places[found] = place;
    return found + 1;
}

/* The places of the zeros and of the rectangles left over, in order, then +inf: of intervals that overlap or touch the middle,
   or both ends if that is wide. Returns the part of the whole in which there may be others. */
static double teg_places(teg_location *s, double *places, int room)
{
    const int left = s->left;
    const double same = TEG_LOCATE_SAME * s->extent;
    double *const across = s->across[s->level & 1], lost = 0.0, from = 0.0, to = 0.0;
    int found = 0, open = 0, inside = 0;
    if (s->found > TEG_LOCATE_ZEROS) {
        teg_fill(places, room, INFINITY);
        return 1.0;
    }
    teg_sort(s->zeros, s->found);
    teg_sort(across, left);
    for (int i = 0, k = 0; i < s->found || k < left || open;) {
        const double zero = i < s->found ? s->zeros[i] - same : INFINITY;
        const double other = k < left ? s->lo + s->extent * across[k] : INFINITY;
        const int next = other < zero, any = next || i < s->found;
        const double begin = next ? other : zero;
        const double end = next ? s->lo + s->extent * (across[k] + s->wide) : any ? s->zeros[i] + same : INFINITY;
        if (next) k++;
        else i++;
        if (open && begin <= to) {
            if (end > to) to = end;
            inside += next;
            continue;
        }
        if (open && to - from > TEG_LOCATE_NARROW * s->extent) {
            found = teg_put_place(places, room, found, from);
            found = teg_put_place(places, room, found, to);
            lost += inside;
        } else if (open) {
            found = teg_put_place(places, room, found, 0.5 * (from + to));
        }
        open = any;
        inside = next;
        from = begin;
        to = end;
    }
    lost *= s->wide * s->tall;
    if (found > room) {
        const double behind = (s->lo + s->extent - places[room - 1]) / s->extent;
        return behind > 0.0 ? fmin(1.0, lost + behind) : lost;
    }
    teg_fill(places + found, room - found, INFINITY);
    return lost;
}

/* Points of sampled integrals: see teg/numerics/sobol.py. 64 bits well mixed. */
static inline uint64_t teg_mix(uint64_t z)
{
    z = (z ^ z >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ z >> 27) * UINT64_C(0x94D049BB133111EB);
    return z ^ z >> 31;
}

/* The 64 bits that tell one replicate of one dimension from all others. */
static inline uint64_t teg_key(uint64_t seed, int replicate, int dimension)
{
    return teg_mix(teg_mix(seed + UINT64_C(0x9E3779B97F4A7C15)) ^ ((uint64_t)replicate << 32 | (uint64_t)dimension));
}

/* The centre of a cell of width 2^-52. */
static inline double teg_centre(uint64_t cell)
{
    return (double)(int64_t)(2 * cell + 1) * 0x1p-53;
}

/* The coordinate of a pseudo-random point. */
static inline double teg_random(uint64_t key, uint64_t index)
{
    return teg_centre(teg_mix(key + index * UINT64_C(0x9E3779B97F4A7C15)) >> 12);
}

/* 32 bits in reverse. */
static inline uint32_t teg_reversed(uint32_t x)
{
    x = x >> 16 | x << 16;
    x = (x >> 8 & 0x00FF00FFu) | (x & 0x00FF00FFu) << 8;
    x = (x >> 4 & 0x0F0F0F0Fu) | (x & 0x0F0F0F0Fu) << 4;
    x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;
    return (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;
}

/* The coordinate of a Sobol' point, scrambled; x is the point's 32 bits in reverse. */
static inline double teg_scrambled(uint64_t key, uint32_t x)
{
    x ^= x * 0x3D20ADEAu;
    x = (x + (uint32_t)key) * ((uint32_t)(key >> 32) | 1u);
    x ^= x * 0x05526C56u;
    x ^= x * 0x53A22864u;
    const uint64_t upper = teg_reversed(x);
    return teg_centre(upper << 20 | teg_mix(key + upper * UINT64_C(0x9E3779B97F4A7C15)) >> 44);
}

/* Which direction number leads from Sobol' point i to the next one, in the order of Gray's code. */
static inline int teg_column(uint64_t i)
{
    int column = 0;
    for (; i & 1u; i >>= 1) column++;
    return column;
}

/* The first block of Sobol' points of a dimension, 32 bits in reverse. The points of another block differ from them by its first one. */
static inline void teg_first_block(uint32_t *points, const uint32_t *directions)
{
    points[0] = 0;
    for (int i = 0; i + 1 < TEG_BLOCK; i++) points[i + 1] = points[i] ^ directions[teg_column((uint64_t)i)];
}

/* The coordinates of the points of a block that begins with x. */
static inline void teg_coordinates(double *at, int n, uint64_t key, uint32_t x, const uint32_t *first_block)
{
    for (int k = 0; k < n; k++) at[k] = teg_scrambled(key, x ^ first_block[k]);
}

/* The first point of the next block, from that of the block that begins with point i; TEG_BLOCK is 2^6. */
static inline uint32_t teg_next_block(uint32_t x, uint64_t i, const uint32_t *directions)
{
    return x ^ directions[5] ^ directions[6 + teg_column(i / TEG_BLOCK)];
}

/* Standard errors of n means over replicates, from the means of each replicate. */
static inline void teg_scatter(int n, int replicates, const double *all, const double *mean, double *error)
{
    for (int j = 0; j < n; j++) {
        double squares = 0.0;
        for (int r = 0; r < replicates; r++) squares += (all[n * r + j] - mean[j]) * (all[n * r + j] - mean[j]);
        error[j] = sqrt(squares / (replicates * (replicates - 1.0)));
    }
}

/* Standard errors of n means over `count` independent points, from the first values and the sums of squares relative to them. */
static inline void teg_spread(int n, double count, const double *all, const double *mean, double *error)
{
    for (int j = 0; j < n; j++) {
        const double away = mean[j] - all[j], squares = all[n + j] - count * (away * away);
        error[j] = sqrt((squares < 0.0 ? 0.0 : squares) / (count - 1.0) / count);
    }
}
