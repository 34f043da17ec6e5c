/* Cells that are kept: values first, then derivatives of sums of values with weights that are known by then. */

//: teg_kept
/* Cells, and what has become of them. TEG_NO_CELLS: the square has one owner, or there are none. TEG_CELLS: they are there. TEG_TWO_PARTS: one
   cell is there, and `other` owns the rest of the square. `known`: the polynomials of the owner of the rest are finite, so they are subtracted
   from the others, and its cells are not needed. TEG_SIGNED: there are cells with signs. TEG_TABLES: the tables of all results are there, since the square was cut into tiles,
   or something lies on a side. TEG_UNDEFINED: all is NaN. */
typedef struct {
    teg_room room;
    enum { TEG_NO_CELLS, TEG_CELLS, TEG_TWO_PARTS, TEG_TABLES, TEG_UNDEFINED, TEG_SIGNED } state;
    int64_t other;
    int known;
    double *tables;
} teg_kept;

//: teg_let_go
/* Give back what cells hold. */
static void teg_let_go(teg_kept *kept)
{
    if (kept->state == TEG_NO_CELLS) return;
    teg_end(&kept->room.r);
    free(kept->tables);
}

//: teg_owned
/* Add what an owner's moments give to values, and these to its moments. */
static inline void teg_owned(const teg_shape *s, const double *f, const double *m, double *values, double *moments)
{
    const int count = teg_coefficients(s);
    for (int body = 0; body < s->bodies; body++) {
        double value = 0.0;
        for (int j = 0; j < count; j++) value += f[body * count + j] * m[j];
        values[body] += value;
    }
    for (int j = 0; j < count; j++) moments[j] += m[j];
}

//: teg_whole
/* Values and moments of a square that has one owner. They are not added to zeros: what was just written in wide pieces is read late. */
static inline void teg_whole(const teg_shape *s, const double *f, double *values, double *moments)
{
    const int count = teg_coefficients(s);
    double m[TEG_MONOMIALS];
    teg_square_moments(s, m);
    for (int body = 0; body < s->bodies; body++) {
        double value = 0.0;
        for (int j = 0; j < count; j++) value += f[body * count + j] * m[j];
        values[body] = value;
    }
    for (int j = 0; j < count; j++) moments[j] = m[j];
}

//: teg_values
/* Values and moments of an arrangement. Those of the base are what the other cells leave, if its polynomials are known. */
static void teg_values(
    const teg_arrangement *r, int64_t base, int finite, const double *otherwise, double *values, double *moments, unsigned char *seen)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int count = teg_coefficients(s), whole = !r->region_count || (r->cell_count == 1 && r->cells[0].owner == base);
    const int64_t base_row = base < 0 ? r->n : base / s->parts;
    const double *const f = teg_polynomials(r, base, otherwise);
    const int known = whole || finite;
    double m[TEG_MONOMIALS], rest[TEG_MONOMIALS];
    teg_square_moments(s, rest);
    for (size_t k = 0; k < r->cell_count && !whole; k++) {
        const teg_cell *const cell = r->cells + k;
        const int64_t row = cell->owner < 0 ? r->n : cell->owner / s->parts;
        if (known && cell->owner == base) continue;
        for (int j = 0; j < count; j++) m[j] = 0.0;
        teg_cell_moments(r, cell, NULL, NULL, m, NULL);
        for (int j = 0; j < count; j++) m[j] *= cell->weight, rest[j] -= m[j];
        teg_owned(s, teg_polynomials(r, cell->owner, otherwise), m, values, moments + row * count);
        seen[row] = 1;
    }
    if (known) {
        teg_owned(s, f, rest, values, moments + base_row * count);
        seen[base_row] = 1;
    }
}

//: teg_is_opposite
/* Whether line h, whose form is at most 0 on a piece of the square that line g cuts off, separates it from the rest as g does: what cutting
   both parts by h would find. */
static int teg_is_opposite(const teg_line *h, const teg_line *g, const teg_piece *piece)
{
    const double one[4] = {g->c, g->c + g->a, g->c + g->a + g->b, g->c + g->b}, two[4] = {h->c, h->c + h->a, h->c + h->a + h->b, h->c + h->b};
    double d[TEG_PIECE];
    unsigned near;
    for (int k = 0; k < 4; k++) {
        const double e = fabs(two[k]) < TEG_ON_LINE ? 0.0 : two[k];
        if ((one[k] > 0.0) != (e < 0.0) || (one[k] < 0.0) != (e > 0.0)) return 0;
    }
    teg_on_corners(h->c, h->a, h->b, piece->x, piece->y, d);
    near = teg_on_line(d) & ((1u << piece->n) - 1);
    return (near & (near - 1)) && teg_below_level(d, TEG_ON_LINE) == (1u << TEG_PIECE) - 1;
}

//: teg_one_part
/* The part of the square on a region. Returns 0 where nothing is cut off, nothing is left, or a corner lies on a line. */
static int teg_one_part(const teg_arrangement *r, const teg_region *region, teg_piece *piece)
{
    int cut = 0;
    teg_copy_piece(&teg_square, piece);
    for (int line = region->first; line < region->end; line++) {
        const int state = teg_trim(piece, r->lines[line].c, r->lines[line].a, r->lines[line].b, 2 * line);
        if (state > TEG_PART) return 0;
        cut |= state == TEG_PART;
    }
    return cut;
}

//: teg_two_parts
/* Make the cell of a square that has two parts: a region in front of the base or of nothing, and the rest; or two regions on both sides of one
   line. This is what most squares with an edge are. Returns 0 where it is anything else. */
static int teg_two_parts(teg_kept *kept, const double *otherwise)
{
    teg_arrangement *const r = &kept->room.r;
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const teg_region *const first = r->regions;
    const int two = r->region_count == 2;
    teg_piece piece;
    if (r->region_count < 1 || r->region_count > 2 || first->end - first->first > 8 || (two && (r->base >= 0 || r->line_count != 6))) return 0;
    if (two && first->end - first->first != 1) return 0;
    teg_sort_regions(r->regions, r->region_count);
    kept->other = two ? r->regions[1].region : r->base;
    if (two && kept->other / s->parts == first->region / s->parts) return 0;
    if (!first->front || !teg_is_known(s, teg_polynomials(r, kept->other, otherwise))) return 0;
    if (!teg_one_part(r, first, &piece)) return 0;
    if (two && !teg_is_opposite(r->lines + r->regions[1].first, r->lines + first->first, &piece)) return 0;
    teg_cell_of(r, &piece, first->region);
    kept->state = TEG_TWO_PARTS;
    return 1;
}

//: teg_has_signs
/* Make the cells with signs of a square; returns 0, and leaves nothing behind, where they are not known to be right. */
static int teg_has_signs(teg_kept *kept, const double *otherwise)
{
    teg_arrangement *const r = &kept->room.r;
    const size_t lines = r->line_count;
    if (!teg_may_have_signs(r, otherwise)) return 0;
    if (teg_sign_cells(r, otherwise)) {
        kept->state = TEG_SIGNED;
        return 1;
    }
    r->line_count = lines, r->cell_count = r->used = 0;
    return 0;
}

//: teg_keep_tables
/* The tables of all results, and the moments in them. */
static void teg_keep_tables(teg_kept *kept, const double *otherwise, double *values, double *moments, unsigned char *seen)
{
    teg_arrangement *const r = &kept->room.r;
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int count = teg_coefficients(s), forms = teg_forms(s);
    const size_t size = teg_table_size(s, r->n);
    kept->state = TEG_TABLES;
    kept->tables = calloc(size, sizeof *kept->tables);
    if (!kept->tables) {
        r->failed = 1;
        return;
    }
    if (!r->touching) teg_tile(r, NULL, r->n * s->parts, 0, 0, otherwise, (double *const[]){values, NULL, kept->tables});
    if (r->touching) teg_moved_tables(r, otherwise, kept->tables);
    if (r->ambiguous) teg_no_slopes(s, r->n, kept->tables);
    for (int64_t row = 0; row <= r->n; row++) {
        for (int j = 0; j < count; j++) moments[row * count + j] = kept->tables[row * (forms + count) + forms + j];
        seen[row] = 3;
    }
}

//: teg_keep_several
/* `teg_keep_or_wait` of a square that may have more than one owner. */
TEG_APART int teg_keep_several(teg_kept *kept, const teg_shape *shape, int64_t n, const double *rows, const double *otherwise, double *values,
    double *moments, unsigned char *seen, int may, teg_fans *fans, const int *waiting)
{
    const teg_shape *const s = TEG_SHAPE(shape);
    const int count = teg_coefficients(s);
    teg_arrangement *const r = &kept->room.r;
    for (int body = 0; body < s->bodies; body++) values[body] = 0.0;
    for (int64_t k = 0; k < (n + 1) * count; k++) moments[k] = 0.0;
    for (int64_t k = 0; k <= n; k++) seen[k] = 0;
    teg_begin(&kept->room, s, n, rows);
    kept->state = TEG_CELLS, kept->known = 1, kept->tables = NULL;
    teg_select_on_square(r, n * s->parts);
    if (may) {
        const int queue = teg_may_wait(r);
        if (queue && may >> queue & 1) {
            teg_waits(r, fans + queue - 2, waiting[queue]);
            teg_end(r);
            kept->state = TEG_NO_CELLS;
            return queue;
        }
    }
    if (!r->undefined && !r->failed) {
        if (teg_is_tiled(r, 0, r->region_count)) teg_keep_tables(kept, otherwise, values, moments, seen);
        else if (teg_two_parts(kept, otherwise)) teg_values(r, kept->other, 1, otherwise, values, moments, seen);
        else if (teg_has_signs(kept, otherwise)) teg_values(r, r->base, 1, otherwise, values, moments, seen);
        else {
            kept->known = teg_is_known(s, teg_polynomials(r, r->base, otherwise));
            if (r->region_count) teg_arrange(r, kept->known);
            if (!r->failed) teg_values(r, r->base, kept->known, otherwise, values, moments, seen);
            if (!r->failed && r->touching) teg_keep_tables(kept, otherwise, values, moments, seen);
        }
    }
    if (!r->undefined) return r->failed;
    kept->state = TEG_UNDEFINED;
    teg_fill(values, s->bodies, NAN);
    for (int64_t k = 0; k < (n + 1) * count; k++) moments[k] = NAN;
    for (int64_t k = 0; k <= n; k++) seen[k] = 3;
    return r->failed;
}

//: teg_keep_or_wait
/* Values of n candidates, moments of these and of what is outside of all, and which of both are seen: 1 (3 with derivatives by forms).
   Returns 1 without memory, else 0; or the square waits, and where it does is returned (see `teg_may_wait`). `may`: where there is
   room, as bits; `waiting`: how many wait there. */
static inline int teg_keep_or_wait(teg_kept *kept, const teg_shape *shape, int64_t n, const double *rows, const double *otherwise,
    double *values, double *moments, unsigned char *seen, int may, teg_fans *fans, const int *waiting)
{
    const teg_shape *const s = TEG_SHAPE(shape);
    const int count = teg_coefficients(s);
    kept->room.r.shape = shape, kept->room.r.n = n;
    if (n > 1 || (n == 1 && !teg_covers(s, rows)))
        return teg_keep_several(kept, shape, n, rows, otherwise, values, moments, seen, n < 3 ? 0 : may, fans, waiting);
    teg_whole(s, n ? rows + teg_forms(s) : otherwise, values, moments);
    seen[0] = 1;
    for (int j = 0; j < count && n; j++) moments[count + j] = 0.0;
    if (n) seen[1] = 0;
    return 0;
}

//: teg_keep_cells
/* The same of a square that does not wait. */
static inline int teg_keep_cells(teg_kept *kept, const teg_shape *shape, int64_t n, const double *rows, const double *otherwise, double *values,
    double *moments, unsigned char *seen)
{
    return teg_keep_or_wait(kept, shape, n, rows, otherwise, values, moments, seen, 0, NULL, NULL);
}

//: teg_combined
/* The weighted sum of tables of so many rows, in the columns of forms, and the moments of the first one. */
static void teg_combined(int64_t rows, int tables, const double *const *of, const int *widths, const double *weights, int forms, int columns,
    double *to)
{
    for (int64_t row = 0; row < rows; row++)
        for (int c = 0; c < columns; c++) {
            double sum = c < forms ? 0.0 : of[0][row * widths[0] + c];
            for (int k = 0; k < tables && c < forms; k++) {
                const double slope = of[k][row * widths[k] + c];
                if (slope != 0.0) sum += weights[k] * slope;
            }
            to[row * columns + c] = sum;
        }
}

//: teg_give
/* Add integrals along an edge to the derivatives by the forms of its line. */
static inline void teg_give(const teg_arrangement *r, const teg_line *line, const double *sums, double *table, unsigned char *seen)
{
    const int forms = teg_forms(TEG_SHAPE(r->shape));
    if (line->plus >= 0) {
        double *const to = table + line->plus * forms + line->column;
        to[0] += sums[0], to[1] += sums[1], to[2] += sums[2];
        seen[line->plus] = 3;
    }
    if (line->minus >= 0) {
        double *const to = table + line->minus * forms + line->column;
        to[0] -= sums[0], to[1] -= sums[1], to[2] -= sums[2];
        seen[line->minus] = 3;
    }
}

//: teg_along_edge
/* Add the integral of a polynomial times 1, u, v along a part of an edge (x, y) + t (dx, dy) to the derivatives by the forms of its line. */
static inline void teg_along_edge(const teg_arrangement *r, const teg_line *line, const double *edge, const double *part, double scale,
    const double *f, double *table, unsigned char *seen)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int count = teg_coefficients(s);
    double sums[3] = {0.0, 0.0, 0.0}, at[TEG_MONOMIALS];
    for (int point = 0; point < s->points; point++) {
        const double t = part[0] + s->gauss[2 * point] * (part[1] - part[0]), x = edge[0] + t * edge[2], y = edge[1] + t * edge[3];
        double value = 0.0;
        teg_monomials(x, y, 0.0, 0.0, s->degree, at, NULL);
        for (int k = 0; k < count; k++) value += f[k] * at[k];
        value *= scale * s->gauss[2 * point + 1];
        sums[0] += value, sums[1] += value * x, sums[2] += value * y;
    }
    teg_give(r, line, sums, table, seen);
}

//: teg_around_edge
/* Add what an edge of a cell gives to the derivatives by forms, f being the difference of the polynomials on both sides. */
static void teg_around_edge(const teg_arrangement *r, const teg_cell *cell, int i, const double *f, double *table, unsigned char *seen)
{
    const int label = r->label[cell->at + i], j = i + 1 == cell->n ? 0 : i + 1;
    const double x = r->x[cell->at + i], y = r->y[cell->at + i];
    const double edge[4] = {x, y, r->x[cell->at + j] - x, r->y[cell->at + j] - y};
    const double length = sqrt(edge[2] * edge[2] + edge[3] * edge[3]) * (label & 1 ? -1.0 : 1.0);
    double part[2] = {0.0, 1.0}, sign;
    int share;
    if (r->lines[label >> 1].twin < 0) {
        teg_along_edge(r, r->lines + (label >> 1), edge, part, length / r->lines[label >> 1].size, f, table, seen);
        return;
    }
    part[0] = part[1] = -1.0;
    while (teg_next_share(r, label >> 1, edge, part, &share, &sign)) {
        const teg_line *const line = r->lines + share;
        teg_along_edge(r, line, edge, part, sign * length * (part[1] - part[0]) / line->size, f, table, seen);
    }
}

//: teg_around_piece
/* The same for all edges of a piece, which are computed side by side. Returns 0 where that is not to be had. An edge has the direction (b, -a)
   of its line where the form is >= 0 on its left, so no root is needed. */
static inline int teg_around_piece(const teg_arrangement *r, const teg_cell *cell, const double *f, double *table, unsigned char *seen)
{
#if TEG_WIDE == 8
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const __m512i behind = _mm512_setr_epi64(1, 2, 3, 4, 5, 6, 7, 0);
    const int *const label = r->label + cell->at;
    const __m512d x = _mm512_loadu_pd(r->x + cell->at), y = _mm512_loadu_pd(r->y + cell->at);
    const __m512d dx = _mm512_permutexvar_pd(behind, x) - x, dy = _mm512_permutexvar_pd(behind, y) - y;
    __m512d sums[3] = {_mm512_setzero_pd(), _mm512_setzero_pd(), _mm512_setzero_pd()}, at[TEG_MONOMIALS];
    double all[5][TEG_PIECE];
    for (int point = 0; point < s->points; point++) {
        const __m512d t = _mm512_set1_pd(s->gauss[2 * point]), px = x + t * dx, py = y + t * dy;
        __m512d value = _mm512_set1_pd(f[0]);
        at[0] = _mm512_set1_pd(1.0);
        for (int total = 1, k = 1, before = 0; total <= s->degree; before += total, total++)
            for (int j = 0; j <= total; j++, k++) {
                at[k] = j < total ? at[before + j] * px : at[before + j - 1] * py;
                value += _mm512_set1_pd(f[k]) * at[k];
            }
        value *= _mm512_set1_pd(s->gauss[2 * point + 1]);
        sums[0] += value, sums[1] += value * px, sums[2] += value * py;
    }
    for (int k = 0; k < 3; k++) _mm512_storeu_pd(all[k], sums[k]);
    _mm512_storeu_pd(all[3], dx);
    _mm512_storeu_pd(all[4], dy);
    for (unsigned own = _mm256_cmp_epi32_mask(_mm256_loadu_si256((const void *)label), _mm256_set1_epi32(8), _MM_CMPINT_NLT); own; own &= own - 1) {
        const int i = teg_lowest_bit(own);
        const teg_line *const line = r->lines + (label[i] >> 1);
        if (line->twin < 0) {
            const double scale = (all[3][i] * line->b - all[4][i] * line->a) / line->size; /* the length, with the sign of the side */
            const double own_sums[3] = {scale * all[0][i], scale * all[1][i], scale * all[2][i]};
            teg_give(r, line, own_sums, table, seen);
        } else
            teg_around_edge(r, cell, i, f, table, seen);
    }
    return 1;
#else
    (void)r, (void)cell, (void)f, (void)table, (void)seen;
    return 0;
#endif
}

//: teg_around
/* The same for all edges of a cell. */
static void teg_around(const teg_arrangement *r, const teg_cell *cell, const double *f, double *table, unsigned char *seen)
{
    if (cell->n <= TEG_PIECE && teg_around_piece(r, cell, f, table, seen)) return;
    for (int i = 0; i < cell->n; i++)
        if (r->label[cell->at + i] >= 8) teg_around_edge(r, cell, i, f, table, seen);
}

//: teg_pull_cells
/* `teg_pull_back` of a square that may have more than one owner. */
TEG_APART int teg_pull_cells(teg_kept *kept, const double *otherwise, const double *weights, double *table, unsigned char *seen)
{
    teg_arrangement *const r = &kept->room.r;
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int forms = teg_forms(s), count = teg_coefficients(s);
    const int64_t other = kept->state == TEG_TWO_PARTS ? kept->other : r->base;
    const double *const base = teg_polynomials(r, other, otherwise);
    if (kept->state == TEG_UNDEFINED) {
        for (int64_t k = 0; k < (r->n + 1) * forms; k++) table[k] = NAN;
        return 0;
    }
    memset(table, 0, (size_t)((r->n + 1) * forms) * sizeof *table);
    if (r->failed) return 1;
    if (kept->state == TEG_TABLES) {
        for (int body = 0; body < s->bodies; body++)
            for (int64_t k = 0; k < (r->n + 1) * forms; k++) {
                const double slope = kept->tables[(body * (r->n + 1) + k / forms) * (forms + count) + k % forms];
                if (slope != 0.0) table[k] += weights[body] * slope;
            }
        return 0;
    }
    if (!r->region_count || (r->cell_count == 1 && r->cells[0].owner == r->base)) return 0;
    if (r->ambiguous) {
        teg_fill(table, (int)(r->n + 1) * forms, NAN);
        memset(seen, 3, (size_t)r->n + 1);
        return 0;
    }
    if (kept->state == TEG_CELLS) teg_find_twins(r);
    if (r->failed) return 1;
    for (size_t k = 0; k < r->cell_count; k++) {
        const teg_cell *const cell = r->cells + k;
        const double *const own = teg_polynomials(r, cell->owner, otherwise);
        double f[TEG_MONOMIALS];
        if (kept->known && cell->owner == other) continue;
        for (int j = 0; j < count; j++) f[j] = 0.0;
        for (int body = 0; body < s->bodies; body++)
            for (int j = 0; j < count; j++) {
                const double jump = own[body * count + j] - (kept->known ? base[body * count + j] : 0.0);
                if (jump != 0.0) f[j] += cell->weight * weights[body] * jump;
            }
        teg_around(r, cell, f, table, seen);
    }
    return 0;
}

//: teg_pull_back
/* The derivatives of the weighted sum of all values by the forms of candidates; marks those that are seen by these. Returns 1 without memory. */
static inline int teg_pull_back(teg_kept *kept, const double *otherwise, const double *weights, double *table, unsigned char *seen)
{
    const teg_arrangement *const r = &kept->room.r;
    const int64_t size = (r->n + 1) * teg_forms(TEG_SHAPE(r->shape));
    if (kept->state != TEG_NO_CELLS) return teg_pull_cells(kept, otherwise, weights, table, seen);
    for (int64_t k = 0; k < size; k++) table[k] = 0.0;
    return 0;
}
