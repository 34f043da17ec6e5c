/* Squares with one or two candidates that one of them covers, or that one line cuts in two, eight side by side: most squares are
   like that. They are cut and measured as by `teg_keep_cells` and `teg_pull_back`, to which all others are left. */

//: teg_eight
/* Eight squares: `good` where all is known; `near`: which candidate is on one side of a line (or -1), that of its `guard`, and
   `owner`: which one has the rest, or all; the form of the line divided by its `size`; the ends of the line in the square, where
   the near candidate's part begins (the side of the square follows) and where it ends; the moments of both. */
typedef struct {
    int64_t good[8], near[8], guard[8], owner[8];
    double c[8], a[8], b[8], size[8], x[2][8], y[2][8], moments[2][TEG_MONOMIALS][8];
} teg_eight;

//: teg_eight_signs
/* Of a candidate in eight squares: how many guards have lines that cut them, which one is the last of these, and its form;
   whether the candidate is in the square and finite; its key in the middle, and the highest one. */
typedef struct {
    int64_t cuts[8], guard[8], there[8];
    double line[3][8], middle[8], highest[8];
} teg_eight_signs;

//: teg_signs_in_eight
/* The signs of all guards, as in `teg_signs_on_square`. */
TEG_INLINE void teg_signs_in_eight(const teg_shape *s, const double (*row)[8], teg_eight_signs *signs)
{
    const double(*const key)[8] = row + teg_forms(s) - 3;
    for (int k = 0; k < 8; k++) {
        int64_t cuts = 0, guard = 0, absent = 0, infinite = 0;
        double line[3] = {0.0, 0.0, 0.0};
        for (int q = 0; q < s->guards; q++) {
            const double c = row[3 * q][k], a = row[3 * q + 1][k], b = row[3 * q + 2][k];
            const double square = a * a + b * b, margin = TEG_ON_LINE * TEG_ON_LINE * square;
            const double highest = c + (a > 0.0 ? a : 0.0) + (b > 0.0 ? b : 0.0);
            const double lowest = c + (a < 0.0 ? a : 0.0) + (b < 0.0 ? b : 0.0);
            const int64_t cut = ((lowest * lowest <= margin) | (lowest <= 0.0)) & (square > 0.0);
            absent |= (highest < 0.0) & (highest * highest > margin);
            infinite |= !((fabs(c) < INFINITY) & (square < INFINITY));
            cuts += cut, guard = cut ? q : guard;
            line[0] = cut ? c : line[0], line[1] = cut ? a : line[1], line[2] = cut ? b : line[2];
        }
        infinite |= !((fabs(key[0][k]) < INFINITY) & (fabs(key[1][k]) < INFINITY) & (fabs(key[2][k]) < INFINITY));
        signs->cuts[k] = cuts, signs->guard[k] = guard, signs->there[k] = !(absent | infinite);
        signs->line[0][k] = line[0], signs->line[1][k] = line[1], signs->line[2][k] = line[2];
        signs->middle[k] = key[0][k] + 0.5 * key[1][k] + 0.5 * key[2][k];
        signs->highest[k] = key[0][k] + (key[1][k] > 0.0 ? key[1][k] : 0.0) + (key[2][k] > 0.0 ? key[2][k] : 0.0);
    }
}

//: teg_order_in_eight
/* Which of two candidates is nearer, and which one owns the rest: one that covers the square behind one that a line cuts, or that
   it hides; or two that each have one line. */
TEG_INLINE void teg_order_in_eight(const teg_shape *s, const double (*rows)[8], const teg_eight_signs *signs, teg_eight *e)
{
    const double(*const one)[8] = rows + teg_forms(s) - 3, (*const two)[8] = one + teg_wide(s);
    for (int k = 0; k < 8; k++) {
        const int64_t first = signs[0].cuts[k] == 0, second = signs[1].cuts[k] == 0, covered = first | second;
        const int64_t base = second & (!first | (signs[1].highest[k] < signs[0].highest[k]));
        const double sign = base ? 1.0 : -1.0; /* the key of the other one, without that of the base */
        const double c = sign * (one[0][k] - two[0][k]), a = sign * (one[1][k] - two[1][k]), b = sign * (one[2][k] - two[2][k]);
        const double size = fabs(one[0][k]) > fabs(two[0][k]) ? fabs(one[0][k]) : fabs(two[0][k]);
        const double tolerance = TEG_ON_LINE * (fabs(a) + fabs(b)) + TEG_KEY_ROUNDING * size;
        const int64_t hidden = c + (a < 0.0 ? a : 0.0) + (b < 0.0 ? b : 0.0) > tolerance;
        const int64_t front = c + (a > 0.0 ? a : 0.0) + (b > 0.0 ? b : 0.0) < -2.0 * tolerance;
        const int64_t other = base ? signs[0].cuts[k] : signs[1].cuts[k];
        const int64_t pair = (signs[0].cuts[k] == 1) & (signs[1].cuts[k] == 1), nearer = signs[1].middle[k] < signs[0].middle[k];
        e->good[k] = signs[0].there[k] & signs[1].there[k] & (covered ? hidden | (front & (other == 1)) : pair);
        e->near[k] = covered ? (hidden ? -1 : 1 - base) : nearer;
        e->owner[k] = covered ? base : 1 - nearer;
    }
}

//: teg_cut_in_eight
/* Cut the squares by the lines of the near candidates. Not good are those with a corner on the line, or where the owner's line is
   another. */
TEG_INLINE void teg_cut_in_eight(const teg_eight_signs *signs, teg_eight *e)
{
    for (int k = 0; k < 8; k++) {
        const int64_t two = e->near[k] == 1, lines = e->owner[k] ? signs[1].cuts[k] : signs[0].cuts[k];
        const int64_t pair = (e->near[k] >= 0) & (lines > 0);
        const double g[3] = {two ? signs[1].line[0][k] : signs[0].line[0][k], two ? signs[1].line[1][k] : signs[0].line[1][k],
            two ? signs[1].line[2][k] : signs[0].line[2][k]};
        const double h[3] = {two ? signs[0].line[0][k] : signs[1].line[0][k], two ? signs[0].line[1][k] : signs[1].line[1][k],
            two ? signs[0].line[2][k] : signs[1].line[2][k]};
        const double size = sqrt(g[1] * g[1] + g[2] * g[2]), other = sqrt(h[1] * h[1] + h[2] * h[2]);
        const double c = g[0] / size, a = g[1] / size, b = g[2] / size, p = h[0] / other, q = h[1] / other, r = h[2] / other;
        const double d[4] = {c, c + a, c + a + b, c + b}, f[4] = {p, p + q, p + q + r, p + r};
        int64_t clear = 1, above = 0, opposite = 1;
        double ends[2][2];
        for (int i = 0; i < 4; i++) {
            const int64_t far = fabs(f[i]) >= TEG_ON_LINE;
            clear &= fabs(d[i]) >= TEG_ON_LINE, above += d[i] > 0.0;
            opposite &= (d[i] > 0.0) == ((f[i] < 0.0) & far), opposite &= (d[i] < 0.0) == ((f[i] > 0.0) & far);
        }
        for (int end = 0; end < 2; end++) { /* the side between corners i and j, where the part begins or ends */
            const double side = end ? 1.0 : -1.0, d0 = side * d[0], d1 = side * d[1], d2 = side * d[2];
            const int64_t on0 = (d0 > 0.0) & (d1 < 0.0), on1 = (d1 > 0.0) & (d2 < 0.0), on2 = (d2 > 0.0) & (side * d[3] < 0.0);
            const double di = on0 ? d[0] : on1 ? d[1] : on2 ? d[2] : d[3], dj = on0 ? d[1] : on1 ? d[2] : on2 ? d[3] : d[0];
            const double t = di / (di - dj);
            ends[end][0] = on0 ? t : on1 ? 1.0 : on2 ? 1.0 - t : 0.0, ends[end][1] = on0 ? 0.0 : on1 ? t : on2 ? 1.0 : 1.0 - t;
            opposite &= fabs(p + q * ends[end][0] + r * ends[end][1]) < TEG_ON_LINE;
            e->x[end][k] = ends[end][0], e->y[end][k] = ends[end][1];
        }
        e->c[k] = c, e->a[k] = a, e->b[k] = b, e->size[k] = size, e->guard[k] = two ? signs[1].guard[k] : signs[0].guard[k];
        e->good[k] &= (e->near[k] < 0) | (clear & (above > 0) & (above < 4) & (opposite | !pair));
    }
}

//: teg_moments_in_eight
/* The moments of both: those of the near candidate are of triangles between the beginning of its part and sides of the square. */
TEG_INLINE void teg_moments_in_eight(const teg_shape *s, teg_eight *e)
{
    double square[TEG_MONOMIALS];
    teg_square_moments(s, square);
    for (int k = 0; k < 8; k++) {
        const double px = e->x[0][k], py = e->y[0][k], c = e->c[k], a = e->a[k], b = e->b[k];
        double sums[TEG_MONOMIALS], at[TEG_MONOMIALS];
        for (int j = 0; j < teg_coefficients(s); j++) sums[j] = 0.0;
        for (int side = 0; side < 4; side++) {
            const double x0 = side == 1 || side == 2, y0 = side > 1, x1 = side < 2, y1 = side == 1 || side == 2;
            const int64_t from = c + a * x0 + b * y0 > 0.0, to = c + a * x1 + b * y1 > 0.0;
            const double u0 = from ? x0 - px : 0.0, v0 = from ? y0 - py : 0.0;
            const double u1 = to ? x1 - px : from ? e->x[1][k] - px : 0.0, v1 = to ? y1 - py : from ? e->y[1][k] - py : 0.0;
            const double area = 0.5 * (u0 * v1 - u1 * v0);
            for (int node = 0; node < s->nodes; node++) {
                const double t = s->rule[3 * node], u = s->rule[3 * node + 1], x = px + t * u0 + u * u1, y = py + t * v0 + u * v1;
                at[0] = s->rule[3 * node + 2] * area, sums[0] += at[0];
                for (int total = 1, m = 1, before = 0; total <= s->degree; before += total, total++)
                    for (int j = 0; j <= total; j++, m++) {
                        at[m] = j < total ? at[before + j] * x : at[before + j - 1] * y;
                        sums[m] += at[m];
                    }
            }
        }
        for (int j = 0; j < teg_coefficients(s); j++) {
            const double m = e->near[k] < 0 ? 0.0 : sums[j];
            e->moments[0][j][k] = m, e->moments[1][j][k] = square[j] - m;
        }
    }
}

//: teg_values_in_eight
/* The values of eight squares; those of owners whose polynomials are not finite are not good. */
TEG_INLINE void teg_values_in_eight(
    const teg_shape *s, int candidates, const double (*rows)[8], teg_eight *e, double (*values)[8])
{
    const int count = teg_coefficients(s), wide = candidates > 1 ? teg_wide(s) : 0;
    for (int body = 0; body < s->bodies; body++)
        for (int k = 0; k < 8; k++) {
            double own = 0.0, rest = 0.0;
            for (int j = 0; j < count; j++) {
                const int at = teg_forms(s) + body * count + j;
                const double one = rows[at][k], two = rows[wide + at][k], f = e->owner[k] ? two : one;
                own += (e->near[k] == 1 ? two : one) * e->moments[0][j][k], rest += f * e->moments[1][j][k];
                e->good[k] &= fabs(f) < INFINITY;
            }
            values[body][k] = (e->near[k] < 0 ? 0.0 : own) + rest;
        }
}

//: teg_keep_eight
/* Find, cut and measure eight squares with so many candidates (1 or 2), whose numbers are in `rows`. */
TEG_EIGHT void teg_keep_eight(const teg_shape *shape, int candidates, const double (*rows)[8], teg_eight *e, double (*values)[8])
{
    const teg_shape *const s = TEG_SHAPE(shape);
    teg_eight_signs signs[2];
    teg_signs_in_eight(s, rows, signs);
    if (candidates > 1) {
        teg_signs_in_eight(s, rows + teg_wide(s), signs + 1);
        teg_order_in_eight(s, rows, signs, e);
        teg_cut_in_eight(signs, e);
    } else
        for (int k = 0; k < 8; k++) {
            e->good[k] = signs[0].there[k] & (signs[0].cuts[k] == 0), e->near[k] = -1, e->owner[k] = e->guard[k] = 0;
            e->x[0][k] = e->x[1][k] = e->y[0][k] = e->y[1][k] = e->c[k] = e->a[k] = e->b[k] = 0.0, e->size[k] = 1.0;
        }
    teg_moments_in_eight(s, e);
    teg_values_in_eight(s, candidates, rows, e, values);
}

//: teg_edges_in_eight
/* The derivatives of sums of the values by the forms of both candidates, columns of `table`: `f` are the polynomials of the near
   candidate without those of the owner. */
TEG_INLINE void teg_edges_in_eight(const teg_shape *s, const teg_eight *e, double (*f)[8], double (*table)[8])
{
    const int forms = teg_forms(s), columns = forms + teg_coefficients(s);
    for (int k = 0; k < 8; k++) {
        const int64_t from = e->near[k] < 0 ? -1 : e->near[k] * forms + 3 * e->guard[k];
        const double x0 = e->x[1][k], y0 = e->y[1][k], dx = e->x[0][k] - x0, dy = e->y[0][k] - y0;
        const double scale = (dx * e->b[k] - dy * e->a[k]) / e->size[k]; /* the length, divided by the size */
        double at[TEG_MONOMIALS], sums[3] = {0.0, 0.0, 0.0};
        for (int point = 0; point < s->points; point++) {
            const double t = s->gauss[2 * point], x = x0 + t * dx, y = y0 + t * dy;
            double value = f[0][k];
            at[0] = 1.0;
            for (int total = 1, m = 1, before = 0; total <= s->degree; before += total, total++)
                for (int j = 0; j <= total; j++, m++) {
                    at[m] = j < total ? at[before + j] * x : at[before + j - 1] * y;
                    value += f[m][k] * at[m];
                }
            value *= s->gauss[2 * point + 1];
            sums[0] += value, sums[1] += value * x, sums[2] += value * y;
        }
        for (int j = 0; j < 3; j++) sums[j] *= scale;
        for (int c = 0; c < 2; c++)
            for (int j = 0; j < forms; j++) table[c * columns + j][k] = from == c * forms + j - j % 3 ? sums[j % 3] : 0.0;
    }
}

//: teg_pull_eight
/* The derivatives of weighted sums of the values by the forms of both candidates, and the moments, as columns of `table`. */
TEG_EIGHT void teg_pull_eight(const teg_shape *shape, int candidates, const double (*rows)[8], const teg_eight *e,
    const double (*weights)[8], double (*table)[8])
{
    const teg_shape *const s = TEG_SHAPE(shape);
    const int count = teg_coefficients(s), forms = teg_forms(s), wide = teg_wide(s), columns = forms + count;
    if (candidates > 1) {
        double f[TEG_MONOMIALS][8];
        for (int j = 0; j < count; j++)
            for (int k = 0; k < 8; k++) {
                double sum = 0.0;
                for (int body = 0; body < s->bodies; body++) {
                    const double one = rows[forms + body * count + j][k], two = rows[wide + forms + body * count + j][k];
                    const double jump = (e->near[k] == 1 ? two : one) - (e->owner[k] ? two : one);
                    sum += jump != 0.0 ? weights[body][k] * jump : 0.0;
                }
                f[j][k] = sum;
            }
        teg_edges_in_eight(s, e, f, table);
    } else
        for (int j = 0; j < forms; j++)
            for (int k = 0; k < 8; k++) table[j][k] = 0.0;
    for (int c = 0; c < candidates; c++)
        for (int j = 0; j < count; j++)
            for (int k = 0; k < 8; k++) {
                const double near = e->near[k] == c ? 1.0 : 0.0, rest = e->owner[k] == c ? 1.0 : 0.0;
                table[c * columns + forms + j][k] = near * e->moments[0][j][k] + rest * e->moments[1][j][k];
            }
}
