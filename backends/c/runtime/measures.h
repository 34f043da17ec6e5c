/* Integrals over the cells of an arrangement: moments, what the border changes, and how both move, as teg.numerics.cell_integrals computes
   them. */

//: teg_monomials
/* The monomials of a point, and their derivatives where it moves with (p, q) (`moving` may be NULL). */
static inline void teg_monomials(double x, double y, double p, double q, int degree, double *at, double *moving)
{
    at[0] = 1.0;
    if (moving) moving[0] = 0.0;
    for (int total = 1, k = 1, before = 0; total <= degree; before += total, total++)
        for (int j = 0; j <= total; j++, k++) {
            at[k] = j < total ? at[before + j] * x : at[before + j - 1] * y;
            if (moving) {
                moving[k] = j < total ? (total - j) * at[before + j] * p : 0.0;
                if (j) moving[k] += j * at[before + j - 1] * q;
            }
        }
}

//: teg_rate
/* The derivative of a line's form along the direction, divided by the size of the form. */
static void teg_rate(const teg_arrangement *r, const teg_line *line, double *g)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    g[0] = g[1] = g[2] = line->late ? NAN : 0.0;
    for (int k = 0; k < 2; k++) {
        const int64_t candidate = k ? line->minus : line->plus;
        if (candidate >= 0) {
            const double *const f = r->rows + candidate * teg_row(s) + teg_wide(s) + line->column;
            const double sign = (k ? -1.0 : 1.0) / line->size;
            g[0] += sign * (f[0] + f[1] * r->su + f[2] * r->sv), g[1] += sign * f[1], g[2] += sign * f[2];
        }
    }
}

//: teg_velocities
/* The derivatives of the corners of a cell: each is where the lines of its two edges meet. */
static void teg_velocities(const teg_arrangement *r, const teg_cell *cell, double *p, double *q)
{
    for (int i = 0; i < cell->n; i++) {
        const double x = r->x[cell->at + i], y = r->y[cell->at + i];
        const teg_line *const one = r->lines + (r->label[cell->at + (i ? i : cell->n) - 1] >> 1);
        const teg_line *const two = r->lines + (r->label[cell->at + i] >> 1);
        const double across = one->a * two->b - one->b * two->a;
        double g[3], h[3], s, t;
        teg_rate(r, one, g);
        teg_rate(r, two, h);
        s = -(g[0] + g[1] * x + g[2] * y), t = -(h[0] + h[1] * x + h[2] * y);
        if (fabs(across) > 1e-9)
            p[i] = (s * two->b - one->b * t) / across, q[i] = (one->a * t - s * two->a) / across;
        else
            p[i] = 0.5 * (s * one->a + t * two->a), q[i] = 0.5 * (s * one->b + t * two->b);
    }
}

//: teg_note_parting
/* Note with which speed lines leave the place where two of them meet, the sides of the square among them; cuts go on beyond the region that
   made them. Lines that coincide with one of these two are left out. */
static void teg_note_parting(teg_arrangement *r, double x, double y)
{
    double a[2], b[2], s[2], p = 0.0, q = 0.0;
    int known = 0;
    for (size_t k = 0; k < r->line_count; k++) {
        const teg_line *const line = r->lines + k;
        double g[3], away;
        if (fabs(line->c + line->a * x + line->b * y) > TEG_ON_LINE) continue;
        teg_rate(r, line, g);
        away = -(g[0] + g[1] * x + g[2] * y);
        if (isnan(away)) continue;
        r->moving = teg_most_of(r->moving, fabs(g[0]) + fabs(g[1]) + fabs(g[2]));
        if (known && fabs(a[0] * line->b - b[0] * line->a) <= 1e-9) continue;
        if (known < 2) {
            a[known] = line->a, b[known] = line->b, s[known++] = away;
            if (known == 2) {
                const double across = a[0] * b[1] - b[0] * a[1];
                p = (s[0] * b[1] - b[0] * s[1]) / across, q = (a[0] * s[1] - s[0] * a[1]) / across;
                r->moving = teg_most_of(r->moving, fabs(p) + fabs(q));
            }
        } else if (fabs(a[1] * line->b - b[1] * line->a) > 1e-9)
            r->parting = teg_most_of(r->parting, fabs(line->a * p + line->b * q - away));
    }
}

//: teg_note_partings
/* The same at all places that may be such, or at all corners where there are more than there was room for. */
static void teg_note_partings(teg_arrangement *r)
{
    for (int k = 0; k < r->places; k++) teg_note_parting(r, r->place[2 * k], r->place[2 * k + 1]);
    for (size_t k = 0; r->places == TEG_PLACES && k < r->cell_count; k++)
        for (int i = 0; i < r->cells[k].n; i++) teg_note_parting(r, r->x[r->cells[k].at + (size_t)i], r->y[r->cells[k].at + (size_t)i]);
    r->places = 0;
}

//: teg_piece_moments
/* Add the moments of a piece: its triangles are computed side by side. Returns 0 where that is not to be had. */
static inline int teg_piece_moments(const teg_shape *s, const double *x, const double *y, double *m)
{
#if TEG_WIDE == 8
    const __m512i behind = _mm512_setr_epi64(1, 2, 3, 4, 5, 6, 7, 0);
    const __m512d x0 = _mm512_set1_pd(x[0]), y0 = _mm512_set1_pd(y[0]);
    const __m512d a = _mm512_loadu_pd(x) - x0, b = _mm512_loadu_pd(y) - y0;
    const __m512d c = _mm512_permutexvar_pd(behind, a), d = _mm512_permutexvar_pd(behind, b);
    const __m512d area = _mm512_set1_pd(0.5) * (a * d - c * b);
    __m512d sums[TEG_MONOMIALS], at[TEG_MONOMIALS];
    for (int j = 0; j < teg_coefficients(s); j++) sums[j] = _mm512_setzero_pd();
    for (int node = 0; node < s->nodes; node++) {
        const __m512d t = _mm512_set1_pd(s->rule[3 * node]), u = _mm512_set1_pd(s->rule[3 * node + 1]);
        const __m512d px = x0 + t * a + u * c, py = y0 + t * b + u * d;
        at[0] = _mm512_set1_pd(s->rule[3 * node + 2]) * area, sums[0] += at[0];
        for (int total = 1, k = 1, before = 0; total <= s->degree; before += total, total++)
            for (int j = 0; j <= total; j++, k++) {
                at[k] = j < total ? at[before + j] * px : at[before + j - 1] * py;
                sums[k] += at[k];
            }
    }
    for (int j = 0; j < teg_coefficients(s); j++) m[j] += _mm512_reduce_add_pd(sums[j]);
    return 1;
#else
    (void)s, (void)x, (void)y, (void)m;
    return 0;
#endif
}

//: teg_cell_moments
/* Add the moments of a cell, and their derivatives along the direction (`dm` may be NULL). */
static void teg_cell_moments(const teg_arrangement *r, const teg_cell *cell, const double *p, const double *q, double *m, double *dm)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const double *const x = r->x + cell->at, *const y = r->y + cell->at;
    const int count = teg_coefficients(s);
    double at[TEG_MONOMIALS], slope[TEG_MONOMIALS];
    if (!dm && cell->n <= TEG_PIECE && teg_piece_moments(s, x, y, m)) return;
    for (int k = 1; k + 1 < cell->n; k++) {
        const double a = x[k] - x[0], b = y[k] - y[0], c = x[k + 1] - x[0], d = y[k + 1] - y[0], area = 0.5 * (a * d - c * b);
        for (int node = 0; node < s->nodes; node++) {
            const double t = s->rule[3 * node], u = s->rule[3 * node + 1], w = s->rule[3 * node + 2] * area;
            const double px = x[0] + t * a + u * c, py = y[0] + t * b + u * d;
            if (dm) {
                const double e = p[k] - p[0], f = q[k] - q[0], g = p[k + 1] - p[0], h = q[k + 1] - q[0];
                const double growth = 0.5 * (e * d + a * h - g * b - c * f) * s->rule[3 * node + 2];
                teg_monomials(px, py, p[0] + t * e + u * g, q[0] + t * f + u * h, s->degree, at, slope);
                for (int j = 0; j < count; j++) dm[j] += growth * at[j] + w * slope[j];
            } else
                teg_monomials(px, py, 0.0, 0.0, s->degree, at, NULL);
            for (int j = 0; j < count; j++) m[j] += w * at[j];
        }
    }
}

//: teg_cell_edges
/* Add what the edges of a cell give to the derivatives of all values. `own` and `base` have the polynomials of its owner and of the owner
   of the cells that are left out (or NULL), `change` and `base_change` the directions of these, all four in `polynomials`. */
static void teg_cell_edges(
    const teg_arrangement *r, const teg_cell *cell, const double *p, const double *q, const double *const *polynomials, double *tables)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const double *const own = polynomials[0], *const change = polynomials[1], *const base = polynomials[2], *const base_change = polynomials[3];
    const int count = teg_coefficients(s), columns = teg_forms(s) + count, width = columns * (1 + s->order);
    double at[TEG_MONOMIALS], slope[TEG_MONOMIALS], part[2];
    for (int i = 0; i < cell->n; i++) {
        const int label = r->label[cell->at + i], j = i + 1 == cell->n ? 0 : i + 1;
        const double x0 = r->x[cell->at + i], y0 = r->y[cell->at + i], dx = r->x[cell->at + j] - x0, dy = r->y[cell->at + j] - y0;
        const double edge[4] = {x0, y0, dx, dy};
        double sign_of_line;
        int share;
        part[0] = part[1] = -1.0;
        while (label >= 8 && teg_next_share(r, label >> 1, edge, part, &share, &sign_of_line)) {
            double length, scale, g[3], stretch = 0.0;
            const teg_line *const line = r->lines + share;
            const int whole = part[0] == 0.0 && part[1] == 1.0, known = whole && share == label >> 1;
            length = sqrt(dx * dx + dy * dy), scale = sign_of_line * (label & 1 ? -length : length) / line->size;
            if (!whole) scale *= part[1] - part[0];
            if (s->order) {
                teg_rate(r, line, g);
                if (length > 0.0) stretch = (dx * (p[j] - p[i]) + dy * (q[j] - q[i])) / (length * length);
                stretch -= line->a * g[1] + line->b * g[2];
            }
            for (int point = 0; point < s->points; point++) {
                const double from = s->gauss[2 * point], t = whole ? from : part[0] + from * (part[1] - part[0]);
                const double h = scale * s->gauss[2 * point + 1], x = x0 + t * dx, y = y0 + t * dy;
                double vx = 0.0, vy = 0.0;
                if (s->order) vx = p[i] + t * (p[j] - p[i]), vy = q[i] + t * (q[j] - q[i]);
                teg_monomials(x, y, vx, vy, s->degree, at, s->order ? slope : NULL);
                for (int body = 0; body < s->bodies; body++) {
                    double *const table = tables + body * (r->n + 1) * width;
                    const int first = body * count;
                    double value = 0.0, moved = 0.0;
                    for (int k = 0; k < count; k++) {
                        const double f = base ? own[first + k] - base[first + k] : own[first + k];
                        value += f * at[k];
                        if (s->order) moved += f * slope[k] + (base ? change[first + k] - base_change[first + k] : change[first + k]) * at[k];
                    }
                    value *= h, moved = known ? h * moved + value * stretch : NAN;
                    for (int k = 0; k < 2; k++) {
                        const int64_t candidate = k ? line->minus : line->plus;
                        if (candidate < 0) continue;
                        double *const to = table + candidate * width + line->column, sign = k ? -1.0 : 1.0;
                        if (s->order) {
                            to[0] += sign * moved, to[1] += sign * (moved * x + value * vx), to[2] += sign * (moved * y + value * vy);
                            to[columns] += sign * value, to[columns + 1] += sign * value * x, to[columns + 2] += sign * value * y;
                        } else
                            to[0] += sign * value, to[1] += sign * value * x, to[2] += sign * value * y;
                    }
                }
            }
        }
    }
}

//: teg_from_moments
/* Add what the moments of an owner give to values, sizes and tables, each NULL if it is not wanted. */
static void teg_from_moments(
    const teg_arrangement *r, int64_t row, const double *f, const double *m, const double *dm, double *const *wanted)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int count = teg_coefficients(s), forms = teg_forms(s), columns = forms + count, width = columns * (1 + s->order);
    for (int body = 0; body < s->bodies; body++) {
        const double *const own = f + body * count;
        double value = 0.0, size = 0.0;
        for (int j = 0; j < count; j++) value += own[j] * m[j], size += fabs(own[j]);
        if (wanted[0]) wanted[0][body] += value;
        if (wanted[1]) wanted[1][body] += m[0] * size;
        if (wanted[2]) {
            double *const at = wanted[2] + body * (r->n + 1) * width + row * width + forms;
            for (int j = 0; j < count; j++) {
                at[j] += s->order ? dm[j] : m[j];
                if (s->order) at[columns + j] += m[j];
            }
        }
    }
}

//: teg_square_moments
/* The moments of the unit square. */
static inline void teg_square_moments(const teg_shape *s, double *m)
{
    for (int total = 0, at = 0; total <= s->degree; total++)
        for (int j = 0; j <= total; j++, at++) m[at] = 1.0 / ((total - j + 1) * (j + 1));
}

//: teg_power
/* The integral of the power k - 1 of a coordinate along a side of a tile. */
static inline double teg_power(const double *ends, int k)
{
    double last = 1.0, first = 1.0;
    if (ends[0] == 0.0 && ends[1] == 1.0) return 1.0 / k;
    for (int i = 0; i < k; i++) last *= ends[1], first *= ends[0];
    return (last - first) / k;
}

//: teg_measure
/* Add values, sizes and tables of an arrangement, each NULL if it is not wanted. The cells of the owner of the first one are left out: its
   moments are those of the tile without the others', and its polynomial is subtracted from theirs. */
static void teg_measure(teg_arrangement *r, const double *otherwise, double *values, double *sizes, double *tables)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int count = teg_coefficients(s), forms = teg_forms(s), half = s->bodies * count, wide = teg_wide(s);
    const int64_t numbers = teg_row(s);
    const int64_t base = r->base, base_row = base < 0 ? r->n : base / s->parts;
    const double *const f = base < 0 ? otherwise : r->rows + base_row * numbers + forms;
    const double *const df = base < 0 ? otherwise + half : r->rows + base_row * numbers + wide + forms;
    double m[TEG_MONOMIALS], dm[TEG_MONOMIALS], rest[TEG_MONOMIALS], change[TEG_MONOMIALS], *const wanted[3] = {values, sizes, tables};
    const int whole = !r->region_count || (r->cell_count == 1 && r->cells[0].owner == base);
    int known = 1;
    if (r->undefined) return;
    if (tables && !whole) teg_find_twins(r);
    if (s->order && r->guarded) teg_note_partings(r);
    for (int j = 0; j < half; j++) known &= isfinite(f[j]) && (!s->order || isfinite(df[j]));
    for (int total = 0, at = 0; total <= s->degree; total++)
        for (int j = 0; j <= total; j++, at++) rest[at] = teg_power(r->u, total - j + 1) * teg_power(r->v, j + 1), change[at] = 0.0;
    for (size_t k = 0; k < r->cell_count && !whole; k++) {
        const teg_cell *const cell = r->cells + k;
        const int64_t row = cell->owner < 0 ? r->n : cell->owner / s->parts;
        const double *const own = cell->owner < 0 ? otherwise : r->rows + row * numbers + forms;
        const double *const moving = cell->owner < 0 ? otherwise + half : r->rows + row * numbers + wide + forms;
        const double *const polynomials[4] = {own, moving, known ? f : NULL, known ? df : NULL};
        if (known && cell->owner == base) continue;
        for (int j = 0; j < count; j++) m[j] = dm[j] = 0.0;
        if (s->order) {
            if (!teg_room_in_scratch(r, (size_t)cell->n + 2)) return;
            teg_velocities(r, cell, r->px, r->py);
        }
        teg_cell_moments(r, cell, r->px, r->py, m, s->order ? dm : NULL);
        for (int j = 0; j < count; j++) rest[j] -= m[j], change[j] -= dm[j];
        teg_from_moments(r, row, own, m, dm, wanted);
        if (tables) teg_cell_edges(r, cell, r->px, r->py, polynomials, tables);
    }
    if (known || whole) teg_from_moments(r, base_row, f, rest, change, wanted);
}

//: teg_along_direction
/* The derivative of one value along the direction, from its table. */
static double teg_along_direction(const teg_arrangement *r, int body, const double *otherwise, const double *table)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int count = teg_coefficients(s), forms = teg_forms(s), columns = forms + count, first = forms + body * count;
    const double *const last = table + r->n * 2 * columns + columns + forms, *const d = otherwise + (s->bodies + body) * count;
    double total = 0.0;
    for (int64_t k = 0; k < r->n; k++) {
        const double *const own = table + k * 2 * columns + columns, *const moving = r->rows + k * teg_row(s) + teg_wide(s);
        for (int j = 0; j < columns; j++) {
            if (own[j] != 0.0) total += moving[j < forms ? j : first + j - forms] * own[j];
        }
    }
    for (int j = 0; j < count; j++)
        if (last[j] != 0.0) total += d[j] * last[j];
    return total;
}
