/* Squares that few regions cover side by side, as around the vertices of a mesh, eight squares at a time. Nothing is cut: on each
   line the span of a region's part is found between its other line and the sides, and moments are sums over spans (the divergence
   theorem). Regions are known to be side by side where each span is that of one other region, turned round, and the areas are 1
   in all: how many regions lie over a place does not change across such a span. What is not clear is left to `teg_keep_cells`. */

//: TEG_LANES
/* Before a short loop over eight numbers: gcc writes eight copies of it else, of which it makes no vectors. */
#if defined(__GNUC__) && !defined(__clang__)
#define TEG_LANES _Pragma("GCC unroll 1")
#else
#define TEG_LANES
#endif

//: TEG_SLOTS
enum { TEG_SLOTS = 6, TEG_SLOT_LINES = 2, TEG_FAN_LINES = TEG_SLOTS * TEG_SLOT_LINES };

//: teg_fans
/* Eight squares: `pick`: their candidates, the nearest one first (or -1), and their keys; the lines of their guards, two for
   each, as forms divided by `size` (all 0 but c = 1 and `idle` = 1 where there is none), with the columns of their derivatives.
   Spans go from `lo` to `hi`. `matches`: how many spans are the same, turned round (1 for what is empty); `to` and `scale`: where
   the derivatives of a span go. `least` is the sine of the smallest angle, `shortest` the length of the shortest span. `seen`: 2,
   or 0 for those that have no part. */
typedef struct {
    TEG_ALIGNED int64_t pick[TEG_SLOTS][8], column[TEG_FAN_LINES][8], good[8], seen[TEG_SLOTS][8], to[TEG_FAN_LINES][8];
    double key[TEG_SLOTS][3][8], c[TEG_FAN_LINES][8], a[TEG_FAN_LINES][8], b[TEG_FAN_LINES][8], size[TEG_FAN_LINES][8];
    double lo[TEG_FAN_LINES][8], hi[TEG_FAN_LINES][8], inverse[2][TEG_FAN_LINES][8], idle[TEG_FAN_LINES][8];
    double least[8], shortest[8], matches[TEG_FAN_LINES][8], scale[TEG_FAN_LINES][8], moments[TEG_SLOTS][TEG_MONOMIALS][8];
} teg_fans;

//: teg_waits
/* Let a square wait at a place, if it may be such a square. */
static void teg_waits(teg_arrangement *r, teg_fans *t, int k)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int count = (int)r->region_count;
    teg_sort_regions(r->regions, r->region_count);
    for (int slot = 0; slot < TEG_SLOTS; slot++) {
        const teg_region *const region = r->regions + (slot < count ? slot : 0);
        const double *const key = r->rows + region->region * teg_row(s) + teg_forms(s) - 3;
        t->pick[slot][k] = slot < count ? region->region : -1;
        for (int j = 0; j < 3; j++) t->key[slot][j][k] = key[j];
        for (int j = 0; j < TEG_SLOT_LINES; j++) {
            const teg_line *const line = r->lines + region->first + j;
            const int is = slot < count && region->first + j < region->end, at = TEG_SLOT_LINES * slot + j;
            t->c[at][k] = is ? line->c : 1.0, t->a[at][k] = is ? line->a : 0.0, t->b[at][k] = is ? line->b : 0.0;
            t->size[at][k] = is ? line->size : 1.0, t->column[at][k] = is ? line->column : 0;
        }
    }
}

//: teg_may_wait
/* Returns which squares a square may wait with: 2 those of three regions, 3 of more, 0: it may not. */
static inline int teg_may_wait(teg_arrangement *r)
{
    const int count = (int)r->region_count;
    int lines = 0;
    if (r->undefined || r->failed || r->base >= 0 || count < 3 || count > TEG_SLOTS) return 0;
    for (int k = 0; k < count; k++) {
        const int own = r->regions[k].end - r->regions[k].first;
        lines = own > lines ? own : lines;
    }
    return lines > TEG_SLOT_LINES || !teg_may_have_twins(r) ? 0 : count > 3 ? 3 : 2;
}

//: teg_begin_spans
/* Spans of a line in the square. Not good is a square with a corner on the line. */
TEG_INLINE void teg_begin_spans(teg_fans *t, int i)
{
    const double *const pc = t->c[i], *const pa = t->a[i], *const pb = t->b[i];
    double lo[8], hi[8], inverse[2][8], idle[8];
    int64_t clear[8];
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double c = pc[k], a = pa[k], b = pb[k], x = -c * a, y = -c * b, u = 1.0 / b, v = -1.0 / a;
        const double left = -x * u, right = (1.0 - x) * u, bottom = -y * v, top = (1.0 - y) * v;
        const double x0 = left < right ? left : right, x1 = left < right ? right : left;
        const double y0 = bottom < top ? bottom : top, y1 = bottom < top ? top : bottom;
        lo[k] = x0 > y0 ? x0 : y0, hi[k] = x1 < y1 ? x1 : y1, inverse[0][k] = u, inverse[1][k] = -v;
        idle[k] = (a == 0.0) & (b == 0.0) ? 1.0 : 0.0;
        clear[k] = (fabs(c) >= TEG_BESIDE) & (fabs(c + a) >= TEG_BESIDE);
        clear[k] &= (fabs(c + b) >= TEG_BESIDE) & (fabs(c + a + b) >= TEG_BESIDE);
    }
    TEG_LANES for (int k = 0; k < 8; k++) t->lo[i][k] = lo[k], t->hi[i][k] = hi[k], t->good[k] &= clear[k];
    TEG_LANES for (int k = 0; k < 8; k++) t->inverse[0][i][k] = inverse[0][k], t->inverse[1][i][k] = inverse[1][k];
    TEG_LANES for (int k = 0; k < 8; k++) t->idle[i][k] = idle[k];
}

//: teg_part_spans
/* Leave of the spans of two lines what is on the right side of the other one; where they are nearly parallel, the square is not
   good. */
TEG_INLINE void teg_part_spans(teg_fans *t, int i, int j)
{
    const double *const ci = t->c[i], *const ai = t->a[i], *const bi = t->b[i];
    const double *const cj = t->c[j], *const aj = t->a[j], *const bj = t->b[j];
    const double *const idle = t->idle[i], *const other = t->idle[j];
    double *const lo = t->lo[i], *const hi = t->hi[i], *const from = t->lo[j], *const to = t->hi[j];
    double one[8], two[8], turn[8];
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double along = ai[k] * aj[k] + bi[k] * bj[k], across = ai[k] * bj[k] - bi[k] * aj[k], inverse = 1.0 / across;
        const double angle = fabs(across) + (idle[k] + other[k]), least = t->least[k];
        one[k] = (cj[k] - ci[k] * along) * inverse, two[k] = (cj[k] * along - ci[k]) * inverse, turn[k] = across;
        t->least[k] = angle < least ? angle : least;
    }
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double first = lo[k], last = hi[k];
        lo[k] = (turn[k] < 0.0) & (one[k] > first) ? one[k] : first, hi[k] = (turn[k] > 0.0) & (one[k] < last) ? one[k] : last;
    }
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double first = from[k], last = to[k];
        from[k] = (turn[k] > 0.0) & (two[k] > first) ? two[k] : first, to[k] = (turn[k] < 0.0) & (two[k] < last) ? two[k] : last;
    }
}

//: teg_end_spans
/* Make a span that is empty, or has no line, 0 to 0; not good are squares with one that is hardly there, or hardly not. */
TEG_INLINE void teg_end_spans(teg_fans *t, int i)
{
    const double *const idle = t->idle[i];
    double *const lo = t->lo[i], *const hi = t->hi[i];
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double from = lo[k], to = hi[k], length = to - from, shortest = t->shortest[k];
        const double size = (idle[k] == 0.0) ? fabs(length) : 1.0;
        const int64_t some = (idle[k] == 0.0) & (length > 0.0);
        lo[k] = some ? from : 0.0, hi[k] = some ? to : 0.0, t->shortest[k] = size < shortest ? size : shortest;
    }
}

//: teg_side_span
/* The span of a side of the square on the part that lines first to last - 1 bound: sides 0 and 1 are the left and the right one,
   2 and 3 the lower and the upper one. */
TEG_INLINE void teg_side_span(const teg_fans *t, int side, int first, int last, double *from, double *to)
{
    for (int i = first; i < last; i++)
        TEG_LANES for (int k = 0; k < 8; k++) {
            const double a = t->a[i][k], b = t->b[i][k], slope = side < 2 ? b : a;
            const double level = t->c[i][k] + (side == 1 ? a : side == 3 ? b : 0.0), place = -level * t->inverse[side > 1][i][k];
            from[k] = (slope > 0.0) & (place > from[k]) ? place : from[k];
            to[k] = (slope < 0.0) & (place < to[k]) ? place : to[k];
            to[k] = (slope == 0.0) & (level < 0.0) ? -1.0 : to[k];
        }
}

//: teg_end_side
/* The same as `teg_end_spans`, of a side. */
TEG_INLINE void teg_end_side(teg_fans *t, double *from, double *to)
{
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double length = to[k] - from[k], shortest = t->shortest[k], first = from[k], last = to[k];
        t->shortest[k] = fabs(length) < shortest ? fabs(length) : shortest;
        from[k] = length > 0.0 ? first : 0.0, to[k] = length > 0.0 ? last : 0.0;
    }
}

//: teg_add_powers
/* Add what a span of the right (or the upper) side has to the moments, which are divided by their degree later. */
TEG_INLINE void teg_add_powers(const teg_shape *s, int upper, const double *from, const double *to, double (*m)[8])
{
    double low[8], high[8];
    TEG_LANES for (int k = 0; k < 8; k++) low[k] = high[k] = 1.0;
    for (int j = 0; j <= s->degree; j++) {
        TEG_LANES for (int k = 0; k < 8; k++) low[k] *= from[k], high[k] *= to[k];
        const double part = 1.0 / (j + 1);
        for (int total = j; total <= s->degree; total++) { /* x to the power total - j, y to j, or the other way round */
            const int at = total * (total + 1) / 2 + (upper ? total - j : j);
            TEG_LANES for (int k = 0; k < 8; k++) m[at][k] += part * (high[k] - low[k]);
        }
    }
}

//: teg_add_span
/* Add what a span of a line has to the moments. */
TEG_INLINE void teg_add_span(const teg_shape *s, const teg_fans *t, int i, double (*m)[8])
{
    const double *const c = t->c[i], *const a = t->a[i], *const b = t->b[i], *const lo = t->lo[i], *const hi = t->hi[i];
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double x0 = -c[k] * a[k], y0 = -c[k] * b[k], length = hi[k] - lo[k], scale = c[k] * length;
        double at[TEG_MONOMIALS];
        for (int point = 0; point < s->points; point++) {
            const double p = lo[k] + s->gauss[2 * point] * length, x = x0 + p * b[k], y = y0 - p * a[k];
            at[0] = scale * s->gauss[2 * point + 1], m[0][k] += at[0];
            for (int total = 1, n = 1, before = 0; total <= s->degree; before += total, total++)
                for (int j = 0; j <= total; j++, n++) {
                    at[n] = j < total ? at[before + j] * x : at[before + j - 1] * y;
                    m[n][k] += at[n];
                }
        }
    }
}

//: teg_match_spans
/* Note where the spans of two lines are one, turned round: its derivatives are by the line of the nearer region, which is i. */
TEG_INLINE void teg_match_spans(teg_fans *t, int i, int j, int first_column)
{
    double *const found = t->matches[i], *const other = t->matches[j], *const scale = t->scale[j];
    int64_t *const to = t->to[j];
    double is[8];
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double across = t->a[i][k] * t->b[j][k] - t->b[i][k] * t->a[j][k];
        const double along = t->a[i][k] * t->a[j][k] + t->b[i][k] * t->b[j][k], apart = fabs(t->c[i][k] + t->c[j][k]);
        const double begin = fabs(t->lo[i][k] + t->hi[j][k]), end = fabs(t->hi[i][k] + t->lo[j][k]);
        const double far = begin > end ? (begin > apart ? begin : apart) : (end > apart ? end : apart);
        const int64_t same = (along < 0.0) & (fabs(across) < 8.0 / TEG_ANGLES) & (far <= 0.25 * TEG_ON_LINE);
        is[k] = same & (t->hi[i][k] > t->lo[i][k]) ? 1.0 : 0.0;
    }
    TEG_LANES for (int k = 0; k < 8; k++) found[k] += is[k];
    TEG_LANES for (int k = 0; k < 8; k++) other[k] += is[k];
    TEG_LANES for (int k = 0; k < 8; k++) scale[k] = is[k] > 0.0 ? -1.0 / t->size[i][k] : scale[k];
    TEG_LANES for (int k = 0; k < 8; k++) to[k] = is[k] > 0.0 ? t->column[i][k] + first_column : to[k];
}

//: teg_spans_of_fan
/* The spans of all lines, and which are one. Not good is a square with a span that does not belong to two regions. */
TEG_INLINE void teg_spans_of_fan(teg_fans *t, int slots, int columns)
{
    for (int i = 0; i < TEG_SLOT_LINES * slots; i++) teg_begin_spans(t, i);
    for (int i = 0; i < TEG_SLOT_LINES * slots; i += TEG_SLOT_LINES) {
        teg_part_spans(t, i, i + 1);
        teg_end_spans(t, i);
        teg_end_spans(t, i + 1);
    }
    for (int i = 0; i < TEG_SLOT_LINES * slots; i++)
        TEG_LANES for (int k = 0; k < 8; k++) {
            t->matches[i][k] = t->hi[i][k] > t->lo[i][k] ? 0.0 : 1.0;
            t->scale[i][k] = 1.0 / t->size[i][k], t->to[i][k] = t->column[i][k] + i / TEG_SLOT_LINES * columns;
        }
    for (int j = TEG_SLOT_LINES; j < TEG_SLOT_LINES * slots; j++)
        for (int i = 0; i < j / TEG_SLOT_LINES * TEG_SLOT_LINES; i++) teg_match_spans(t, i, j, i / TEG_SLOT_LINES * columns);
    for (int i = 0; i < TEG_SLOT_LINES * slots; i++)
        TEG_LANES for (int k = 0; k < 8; k++) t->good[k] &= t->matches[i][k] == 1.0;
}

//: teg_ties_in_fan
/* Not good is a square along a side of which two keys are equal, and not elsewhere (see `teg_tie_on_side`). */
TEG_INLINE void teg_ties_in_fan(teg_fans *t, int slots)
{
    for (int far = 1; far < slots; far++)
        for (int near = 0; near < far; near++)
            TEG_LANES for (int k = 0; k < 8; k++) {
                const double one = t->key[far][0][k], two = t->key[near][0][k], c = one - two;
                const double a = t->key[far][1][k] - t->key[near][1][k], b = t->key[far][2][k] - t->key[near][2][k];
                const double size = fabs(one) > fabs(two) ? fabs(one) : fabs(two);
                const double tolerance = TEG_ON_LINE * (fabs(a) + fabs(b)) + TEG_KEY_ROUNDING * size;
                const int64_t e0 = fabs(c) <= tolerance, e1 = fabs(c + a) <= tolerance, e2 = fabs(c + b) <= tolerance;
                const int64_t equal = e0 + e1 + e2 + (fabs(c + a + b) <= tolerance);
                t->good[k] &= (equal < 2) | (equal > 3) | (t->pick[far][k] < 0);
            }
}

//: teg_measure_fan
/* The moments of all regions. Not good are squares whose areas are not 1 in all. */
TEG_INLINE void teg_measure_fan(const teg_shape *s, teg_fans *t, int slots)
{
    double all[8];
    TEG_LANES for (int k = 0; k < 8; k++) all[k] = -1.0;
    for (int slot = 0; slot < slots; slot++) {
        double(*const m)[8] = t->moments[slot];
        const int first = TEG_SLOT_LINES * slot;
        for (int j = 0; j < teg_coefficients(s); j++)
            TEG_LANES for (int k = 0; k < 8; k++) m[j][k] = 0.0;
        for (int side = 0; side < 4; side++) {
            double from[8], to[8];
            TEG_LANES for (int k = 0; k < 8; k++) from[k] = 0.0, to[k] = t->pick[slot][k] < 0 ? -1.0 : 1.0;
            teg_side_span(t, side, first, first + TEG_SLOT_LINES, from, to);
            teg_end_side(t, from, to);
            if (side % 2) teg_add_powers(s, side == 3, from, to, m);
        }
        for (int i = first; i < first + TEG_SLOT_LINES; i++) teg_add_span(s, t, i, m);
        for (int total = 0, j = 0; total <= s->degree; total++)
            for (int end = j + total + 1; j < end; j++)
                TEG_LANES for (int k = 0; k < 8; k++) m[j][k] *= 1.0 / (total + 2);
        TEG_LANES for (int k = 0; k < 8; k++) {
            all[k] += m[0][k];
            t->good[k] &= (m[0][k] == 0.0) | (m[0][k] >= TEG_BESIDE);
            t->seen[slot][k] = m[0][k] == 0.0 ? 0 : 2;
        }
    }
    TEG_LANES for (int k = 0; k < 8; k++) t->good[k] &= fabs(all[k]) < TEG_BESIDE;
}

//: teg_keep_fan
/* Find and measure the parts of squares with at most so many regions; `polynomials` are those of these. */
TEG_EIGHT void teg_keep_fan(const teg_shape *shape, int slots, const double (*polynomials)[8], teg_fans *t, double (*values)[8])
{
    const teg_shape *const s = TEG_SHAPE(shape);
    const int count = teg_coefficients(s), half = s->bodies * count;
    TEG_LANES for (int k = 0; k < 8; k++) t->good[k] = 1, t->least[k] = t->shortest[k] = 1.0;
    teg_spans_of_fan(t, slots, teg_forms(s) + count);
    teg_ties_in_fan(t, slots);
    teg_measure_fan(s, t, slots);
    TEG_LANES for (int k = 0; k < 8; k++) t->good[k] &= (t->least[k] >= TEG_ASLANT) & (t->shortest[k] >= TEG_BESIDE);
    for (int body = 0; body < s->bodies; body++)
        TEG_LANES for (int k = 0; k < 8; k++) values[body][k] = 0.0;
    for (int slot = 0; slot < slots; slot++)
        for (int body = 0; body < s->bodies; body++)
            for (int j = 0; j < count; j++)
                TEG_LANES for (int k = 0; k < 8; k++) {
                    const double f = polynomials[slot * half + body * count + j][k];
                    t->good[k] &= fabs(f) < INFINITY;
                    values[body][k] += f * t->moments[slot][j][k];
                }
}

//: teg_edge_of_fan
/* The integrals of a polynomial times 1, u, v along a span. */
TEG_INLINE void teg_edge_of_fan(const teg_shape *s, const teg_fans *t, int i, double (*f)[8], double (*sums)[8])
{
    const double *const c = t->c[i], *const a = t->a[i], *const b = t->b[i], *const lo = t->lo[i], *const hi = t->hi[i];
    TEG_LANES for (int k = 0; k < 8; k++) {
        const double x0 = -c[k] * a[k], y0 = -c[k] * b[k], length = hi[k] - lo[k], scale = length * t->scale[i][k];
        double at[TEG_MONOMIALS], total_sum = 0.0, by_x = 0.0, by_y = 0.0;
        for (int point = 0; point < s->points; point++) {
            const double p = lo[k] + s->gauss[2 * point] * length, x = x0 + p * b[k], y = y0 - p * a[k];
            double value = f[0][k];
            at[0] = 1.0;
            for (int total = 1, n = 1, before = 0; total <= s->degree; before += total, total++)
                for (int j = 0; j <= total; j++, n++) {
                    at[n] = j < total ? at[before + j] * x : at[before + j - 1] * y;
                    value += f[n][k] * at[n];
                }
            value *= scale * s->gauss[2 * point + 1];
            total_sum += value, by_x += value * x, by_y += value * y;
        }
        sums[0][k] = total_sum, sums[1][k] = by_x, sums[2][k] = by_y;
    }
}

//: teg_pull_fan
/* The derivatives of weighted sums of the values by the forms of all candidates, and the moments, as columns of `table`. */
TEG_EIGHT void teg_pull_fan(const teg_shape *shape, int slots, const double (*polynomials)[8], const teg_fans *t,
    const double (*weights)[8], double (*table)[8])
{
    const teg_shape *const s = TEG_SHAPE(shape);
    const int count = teg_coefficients(s), half = s->bodies * count, forms = teg_forms(s), columns = forms + count;
    for (int slot = 0; slot < slots; slot++) {
        double f[TEG_MONOMIALS][8], sums[TEG_SLOT_LINES][3][8];
        memset(table[slot * columns], 0, (size_t)forms * sizeof *table);
        memcpy(table[slot * columns + forms], t->moments[slot], (size_t)count * sizeof *table);
        for (int j = 0; j < count; j++) {
            TEG_LANES for (int k = 0; k < 8; k++) f[j][k] = 0.0;
            for (int body = 0; body < s->bodies; body++)
                TEG_LANES for (int k = 0; k < 8; k++)
                    f[j][k] += weights[body][k] * polynomials[slot * half + body * count + j][k];
        }
        for (int i = 0; i < TEG_SLOT_LINES; i++) teg_edge_of_fan(s, t, TEG_SLOT_LINES * slot + i, f, sums[i]);
        for (int i = 0; i < TEG_SLOT_LINES; i++)
            TEG_LANES for (int k = 0; k < 8; k++)
                for (int j = 0; j < 3 && t->good[k]; j++) table[t->to[TEG_SLOT_LINES * slot + i][k] + j][k] += sums[i][j][k];
    }
}

//: teg_last_in_fan
/* The last place of a candidate in squares that wait. */
static inline int teg_last_in_fan(const teg_fans *t, int there)
{
    int last = 2;
    for (int slot = 3; slot < TEG_SLOTS; slot++)
        for (int k = 0; k < there; k++) last = t->pick[slot][k] < 0 ? last : slot;
    return last;
}
