/* Convex polygons of few corners. Behind the last corner the first one is repeated, up to TEG_PIECE, so that the numbers of all corners are
   computed side by side, however many there are. */

//: TEG_WIDE
/* How many numbers there are instructions for: 8, 4 or 1. TEG_NARROW: use no others. */
#if defined(__AVX__) && !defined(_WIN32) && !defined(TEG_NARROW)
#include <immintrin.h>
#if defined(__AVX512F__) && defined(__AVX512DQ__) && defined(__AVX512VL__)
#define TEG_WIDE 8
#else
#define TEG_WIDE 4
#endif
#else
#define TEG_WIDE 1
#endif

//: teg_piece
/* A convex polygon of n corners, at most TEG_PIECE; `label` of the edge behind each corner: as those of cells. */
typedef struct {
    TEG_ALIGNED double x[TEG_PIECE], y[TEG_PIECE];
    int label[TEG_PIECE], n;
} teg_piece;

//: teg_square
/* The unit square. */
static const teg_piece teg_square = {{0.0, 1.0, 1.0}, {0.0, 0.0, 1.0, 1.0}, {4, 2, 6, 0}, 4};

//: teg_copy_corners
/* Copy corners and labels of a piece. They are read side by side soon, which takes long after they were written in parts. */
static inline void teg_copy_corners(const double *x, const double *y, const int *label, double *u, double *v, int *l)
{
#if TEG_WIDE == 8
    _mm512_storeu_pd(u, _mm512_loadu_pd(x));
    _mm512_storeu_pd(v, _mm512_loadu_pd(y));
    _mm256_storeu_si256((void *)l, _mm256_loadu_si256((const void *)label));
#else
    memcpy(u, x, TEG_PIECE * sizeof *x);
    memcpy(v, y, TEG_PIECE * sizeof *y);
    memcpy(l, label, TEG_PIECE * sizeof *label);
#endif
}

//: teg_copy_piece
static inline void teg_copy_piece(const teg_piece *piece, teg_piece *to)
{
    teg_copy_corners(piece->x, piece->y, piece->label, to->x, to->y, to->label);
    to->n = piece->n;
}

//: teg_lowest_bit
/* The place of the lowest bit of a number that is not 0. */
static inline int teg_lowest_bit(unsigned bits)
{
#ifdef __GNUC__
    return __builtin_ctz(bits);
#else
    int place = 0;
    for (; !(bits & 1u); bits >>= 1) place++;
    return place;
#endif
}

//: teg_close_piece
/* Repeat the first corner. */
static inline void teg_close_piece(int n, double *x, double *y, int *label)
{
    for (int k = n; k < TEG_PIECE; k++) x[k] = x[0], y[k] = y[0], label[k] = 0;
}

//: teg_on_corners
/* The values of a form at all corners. */
static inline void teg_on_corners(double c, double a, double b, const double *x, const double *y, double *d)
{
#if TEG_WIDE == 8
    const __m512d u = _mm512_mul_pd(_mm512_set1_pd(a), _mm512_loadu_pd(x)), v = _mm512_mul_pd(_mm512_set1_pd(b), _mm512_loadu_pd(y));
    _mm512_storeu_pd(d, _mm512_add_pd(_mm512_add_pd(_mm512_set1_pd(c), u), v));
#else
    for (int k = 0; k < TEG_PIECE; k++) d[k] = c + a * x[k] + b * y[k];
#endif
}

//: teg_below_level
/* Which values are below a level, as bits. */
static inline unsigned teg_below_level(const double *d, double level)
{
#if TEG_WIDE == 8
    return _mm512_cmp_pd_mask(_mm512_loadu_pd(d), _mm512_set1_pd(level), _CMP_LT_OQ);
#elif TEG_WIDE == 4
    const __m256d all = _mm256_set1_pd(level), low = _mm256_cmp_pd(_mm256_loadu_pd(d), all, _CMP_LT_OQ);
    return (unsigned)_mm256_movemask_pd(low) | (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(_mm256_loadu_pd(d + 4), all, _CMP_LT_OQ)) << 4;
#else
    unsigned bits = 0;
    for (int k = 0; k < TEG_PIECE; k++) bits |= (unsigned)(d[k] < level) << k;
    return bits;
#endif
}

//: teg_above_level
/* Which values are above a level, as bits. */
static inline unsigned teg_above_level(const double *d, double level)
{
#if TEG_WIDE == 8
    return _mm512_cmp_pd_mask(_mm512_loadu_pd(d), _mm512_set1_pd(level), _CMP_GT_OQ);
#elif TEG_WIDE == 4
    const __m256d all = _mm256_set1_pd(level), low = _mm256_cmp_pd(_mm256_loadu_pd(d), all, _CMP_GT_OQ);
    return (unsigned)_mm256_movemask_pd(low) | (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(_mm256_loadu_pd(d + 4), all, _CMP_GT_OQ)) << 4;
#else
    unsigned bits = 0;
    for (int k = 0; k < TEG_PIECE; k++) bits |= (unsigned)(d[k] > level) << k;
    return bits;
#endif
}

//: teg_on_line
/* Which values count as 0, as bits. */
static inline unsigned teg_on_line(const double *d)
{
#if TEG_WIDE == 8
    return _mm512_cmp_pd_mask(_mm512_abs_pd(_mm512_loadu_pd(d)), _mm512_set1_pd(TEG_ON_LINE), _CMP_LT_OQ);
#elif TEG_WIDE == 4
    const __m256d all = _mm256_set1_pd(TEG_ON_LINE), sign = _mm256_set1_pd(-0.0);
    const __m256d low = _mm256_cmp_pd(_mm256_andnot_pd(sign, _mm256_loadu_pd(d)), all, _CMP_LT_OQ);
    const __m256d high = _mm256_cmp_pd(_mm256_andnot_pd(sign, _mm256_loadu_pd(d + 4)), all, _CMP_LT_OQ);
    return (unsigned)_mm256_movemask_pd(low) | (unsigned)_mm256_movemask_pd(high) << 4;
#else
    unsigned bits = 0;
    for (int k = 0; k < TEG_PIECE; k++) bits |= (unsigned)(fabs(d[k]) < TEG_ON_LINE) << k;
    return bits;
#endif
}

//: teg_part
/* The part of a polygon where its values d, none of which is 0, are above 0 (side 1) or below (side -1); some are, and some are not: the new
   edge gets a label. Returns the number of corners; 0 where they would be more than TEG_PIECE, or the polygon is not convex. Corners
   that stay follow each other. The part may take the place of the polygon. */
static inline int teg_part(int n, const double *x, const double *y, const int *label, const double *d, int side, int cut, double *u, double *v, int *l)
{
    const unsigned all = (1u << n) - 1, above = (side > 0 ? teg_above_level(d, 0.0) : teg_below_level(d, 0.0)) & all, below = ~above & all;
    const unsigned first = (above >> 1 | above << (n - 1)) & below, last = (below >> 1 | below << (n - 1)) & above;
    int enters, leaves, count;
    if (first & (first - 1) || n == TEG_PIECE) return 0;
    enters = teg_lowest_bit(first), leaves = teg_lowest_bit(last); /* an edge begins there and crosses the line */
    count = leaves - enters + (leaves < enters ? n : 0);
    {
#if TEG_WIDE == 8
        const __m512i places = _mm512_setr_epi64(0, 1, 2, 3, 4, 5, 6, 7), behind = _mm512_setr_epi64(1, 2, 3, 4, 5, 6, 7, 0);
        const __m512d px = _mm512_loadu_pd(x), py = _mm512_loadu_pd(y), g = _mm512_loadu_pd(d);
        const __m512d t = _mm512_div_pd(g, _mm512_sub_pd(g, _mm512_permutexvar_pd(behind, g)));
        const __m512d qx = _mm512_add_pd(px, _mm512_mul_pd(t, _mm512_sub_pd(_mm512_permutexvar_pd(behind, px), px)));
        const __m512d qy = _mm512_add_pd(py, _mm512_mul_pd(t, _mm512_sub_pd(_mm512_permutexvar_pd(behind, py), py)));
        const __m512i one = _mm512_set1_epi64(enters), two = _mm512_set1_epi64(leaves), turned = _mm512_add_epi64(places, one);
        const __m512i from = _mm512_min_epu64(turned, _mm512_sub_epi64(turned, _mm512_set1_epi64(n)));
        const __mmask8 end = (__mmask8)(2u << count), ends = (__mmask8)~((4u << count) - 2);
        const __m512d kx = _mm512_mask_permutexvar_pd(_mm512_permutexvar_pd(from, px), ends, one, qx);
        const __m512d ky = _mm512_mask_permutexvar_pd(_mm512_permutexvar_pd(from, py), ends, one, qy);
        const __m256i labels = _mm256_permutevar8x32_epi32(_mm256_loadu_si256((const void *)label), _mm512_cvtepi64_epi32(from));
        const __m256i closed = _mm256_maskz_mov_epi32((__mmask8)((4u << count) - 1), labels);
        _mm512_storeu_pd(u, _mm512_mask_permutexvar_pd(kx, end, two, qx));
        _mm512_storeu_pd(v, _mm512_mask_permutexvar_pd(ky, end, two, qy));
        _mm256_storeu_si256((void *)l, _mm256_mask_mov_epi32(closed, end, _mm256_set1_epi32(cut)));
#else
        double px[TEG_PIECE], py[TEG_PIECE];
        int labels[TEG_PIECE];
        for (int k = 0; k <= count; k++) {
            const int i = enters + k < n ? enters + k : enters + k - n;
            px[k] = x[i], py[k] = y[i], labels[k] = label[i];
        }
        for (int k = 0; k < 2; k++) {
            const int i = k ? leaves : enters, j = i + 1 == n ? 0 : i + 1, at = k ? count + 1 : 0;
            const double t = d[i] / (d[i] - d[j]);
            px[at] = x[i] + t * (x[j] - x[i]), py[at] = y[i] + t * (y[j] - y[i]);
        }
        for (int k = 0; k <= count; k++) u[k] = px[k], v[k] = py[k], l[k] = labels[k];
        u[count + 1] = px[count + 1], v[count + 1] = py[count + 1];
        l[count + 1] = cut;
        teg_close_piece(count + 2, u, v, l);
#endif
    }
    return count + 2;
}

//: teg_signs
/* Guards of a candidate on a tile, as bits: which lines cut it, which guards fail on all of it, and which are not finite. */
typedef struct {
    unsigned cuts, absent, infinite;
} teg_signs;

//: teg_signs_of_four
/* The signs of at most four guards f on the tile from (u[0], v[0]) to (u[1], v[1]), moved by (su, sv), which is the unit square if `whole` is
   not 0. Which of them cut is at random: there are no branches. Numbers are read one by one, as they were written just before. */
TEG_INLINE teg_signs teg_signs_of_four(const double *f, int count, const double *u, const double *v, double su, double sv, int whole)
{
    teg_signs signs = {0, 0, 0};
#if TEG_WIDE >= 4
    const __m256d zero = _mm256_setzero_pd(), infinite = _mm256_set1_pd(INFINITY);
    const __m256d g = _mm256_set_pd(count > 3 ? f[9] : 0.0, count > 2 ? f[6] : 0.0, count > 1 ? f[3] : 0.0, f[0]);
    const __m256d a = _mm256_set_pd(count > 3 ? f[10] : 0.0, count > 2 ? f[7] : 0.0, count > 1 ? f[4] : 0.0, f[1]);
    const __m256d b = _mm256_set_pd(count > 3 ? f[11] : 0.0, count > 2 ? f[8] : 0.0, count > 1 ? f[5] : 0.0, f[2]);
    __m256d c = g, left = zero, right = a, bottom = zero, top = b, square = a * a + b * b;
    const __m256d margin = _mm256_set1_pd(TEG_ON_LINE * TEG_ON_LINE) * square;
    if (!whole) {
        c = g + a * _mm256_set1_pd(su) + b * _mm256_set1_pd(sv);
        left = a * _mm256_set1_pd(u[0]), right = a * _mm256_set1_pd(u[1]), bottom = b * _mm256_set1_pd(v[0]), top = b * _mm256_set1_pd(v[1]);
    }
    const __m256d highest = c + _mm256_max_pd(left, right) + _mm256_max_pd(bottom, top);
    const __m256d lowest = c + _mm256_min_pd(left, right) + _mm256_min_pd(bottom, top);
    const unsigned valid = (1u << count) - 1;
    const __m256d near = _mm256_cmp_pd(lowest * lowest, margin, _CMP_LE_OQ), below = _mm256_cmp_pd(lowest, zero, _CMP_LE_OQ);
    const __m256d outside = _mm256_cmp_pd(highest, zero, _CMP_LT_OQ), far = _mm256_cmp_pd(highest * highest, margin, _CMP_GT_OQ);
    const __m256d sloping = _mm256_cmp_pd(square, zero, _CMP_GT_OQ), bounded = _mm256_cmp_pd(square, infinite, _CMP_LT_OQ);
    const __m256d finite = _mm256_cmp_pd(_mm256_andnot_pd(_mm256_set1_pd(-0.0), c), infinite, _CMP_LT_OQ);
    signs.absent = (unsigned)_mm256_movemask_pd(_mm256_and_pd(outside, far)) & valid;
    signs.cuts = (unsigned)_mm256_movemask_pd(_mm256_and_pd(_mm256_or_pd(near, below), sloping)) & valid;
    signs.infinite = ~(unsigned)_mm256_movemask_pd(_mm256_and_pd(finite, bounded)) & valid;
#else
    for (int q = 0; q < count; q++) {
        const double a = f[3 * q + 1], b = f[3 * q + 2], c = whole ? f[3 * q] : f[3 * q] + a * su + b * sv;
        const double square = a * a + b * b, margin = TEG_ON_LINE * TEG_ON_LINE * square;
        const double left = whole ? 0.0 : a * u[0], right = whole ? a : a * u[1];
        const double bottom = whole ? 0.0 : b * v[0], top = whole ? b : b * v[1];
        const double highest = c + (left > right ? left : right) + (bottom > top ? bottom : top);
        const double lowest = c + (left < right ? left : right) + (bottom < top ? bottom : top);
        signs.absent |= (unsigned)((highest < 0.0) & (highest * highest > margin)) << q;
        signs.cuts |= (unsigned)(((lowest * lowest <= margin) | (lowest <= 0.0)) & (square > 0.0)) << q;
        signs.infinite |= (unsigned)!((fabs(c) < INFINITY) & (square < INFINITY)) << q;
    }
#endif
    return signs;
}

//: teg_signs_of_all
/* The signs of all guards. */
TEG_INLINE teg_signs teg_signs_of_all(const double *f, int count, const double *u, const double *v, double su, double sv, int whole)
{
    teg_signs signs = {0, 0, 0};
    for (int q = 0; q < count; q += 4) {
        const teg_signs few = teg_signs_of_four(f + 3 * q, count - q < 4 ? count - q : 4, u, v, su, sv, whole);
        signs.cuts |= few.cuts << q, signs.absent |= few.absent << q, signs.infinite |= few.infinite << q;
    }
    return signs;
}

//: teg_signs_of
/* The signs of all guards on a tile. */
static inline teg_signs teg_signs_of(const double *f, int count, const double *u, const double *v, double su, double sv)
{
    return teg_signs_of_all(f, count, u, v, su, sv, 0);
}

//: teg_signs_on_square
/* The signs of all guards on the unit square. */
static inline teg_signs teg_signs_on_square(const double *f, int count)
{
    static const double square[2] = {0.0, 1.0};
    return teg_signs_of_all(f, count, square, square, 0.0, 0.0, 1);
}
