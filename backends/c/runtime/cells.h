/* Integrals of the polynomial of the nearest candidate over the unit square, as teg.numerics.cells computes them. */

//: teg_is_tiled
/* Whether a tile is cut into four: one of many regions, most of which have no border of their own, as long as there are fewer tiles than
   regions in all of the square. */
static inline int teg_is_tiled(const teg_arrangement *r, int level, size_t all)
{
    return r->region_count > TEG_MANY_IN_TILE && r->line_count < r->region_count && (size_t)4 << (2 * level) <= all;
}

//: teg_is_moved_later
/* Whether the tables of a square are left to squares that are moved, or whose keys are taken apart. */
static inline int teg_is_moved_later(const teg_arrangement *r)
{
    return (r->touching || r->concurrent) && r->su == 0.0 && r->nudge == 0.0;
}

//: teg_tile
/* Add values, sizes and tables (`wanted`, each NULL if it is not) of a tile with the regions of a list. */
static void teg_tile(teg_arrangement *r, const int64_t *list, int64_t regions, int level, size_t all, const double *otherwise,
    double *const *wanted)
{
    const double u[3] = {r->u[0], r->u[0] + TEG_TILE_U * (r->u[1] - r->u[0]), r->u[1]};
    const double v[3] = {r->v[0], r->v[0] + TEG_TILE_V * (r->v[1] - r->v[0]), r->v[1]};
    int64_t *seen, count = 0;
    teg_select(r, list, regions);
    if (r->undefined || r->failed) return;
    if (level == 0) all = r->region_count, r->guarded = r->line_count > 4;
    if (!teg_is_tiled(r, level, all)) {
        if (r->region_count) teg_arrange(r, 0);
        if (!r->failed) teg_measure(r, otherwise, wanted[0], wanted[1], teg_is_moved_later(r) ? NULL : wanted[2]);
        return;
    }
    seen = malloc((r->region_count + 1) * sizeof *seen);
    if (!seen) {
        r->failed = 1;
        return;
    }
    for (size_t k = 0, before = r->base >= 0; k < r->region_count || before;) {
        const int64_t region = k < r->region_count ? r->regions[k].region : INT64_MAX;
        if (before && r->base < region) seen[count++] = r->base, before = 0;
        else seen[count++] = region, k++;
    }
    for (int k = 0; k < 4 && !r->failed; k++) {
        r->u[0] = u[k & 1], r->u[1] = u[(k & 1) + 1], r->v[0] = v[k >> 1], r->v[1] = v[(k >> 1) + 1];
        teg_tile(r, seen, count, level + 1, all, otherwise, wanted);
    }
    r->u[0] = u[0], r->u[1] = u[2], r->v[0] = v[0], r->v[1] = v[2];
    free(seen);
}

//: teg_covers
/* Whether the first candidate covers the unit square with a margin. */
static inline int teg_covers(const teg_shape *s, const double *rows)
{
    const double *const key = rows + teg_forms(s) - 3;
    const teg_signs signs = teg_signs_on_square(rows, s->guards);
    const int known = (fabs(key[0]) < INFINITY) & (fabs(key[1]) < INFINITY) & (fabs(key[2]) < INFINITY);
    return (s->parts == 1) & known & !(signs.cuts | signs.absent | signs.infinite);
}

//: teg_one_owner
/* Values, sizes (or NULL) and tables (or NULL) of n candidates if the polynomials f, those of a row, hold on the whole unit square. */
static void teg_one_owner(
    const teg_shape *s, int64_t n, int64_t row, const double *f, double *values, double *sizes, double *tables)
{
    const int64_t size = s->bodies * (n + 1) * (teg_forms(s) + teg_coefficients(s));
    double m[TEG_MONOMIALS], *const wanted[3] = {values, sizes, tables};
    teg_arrangement r;
    r.shape = s, r.n = n;
    teg_square_moments(s, m);
    for (int body = 0; body < s->bodies; body++) {
        values[body] = 0.0;
        if (sizes) sizes[body] = 0.0;
    }
    for (int64_t k = 0; tables && k < size; k++) tables[k] = 0.0;
    teg_from_moments(&r, row, f, m, NULL, wanted);
}

//: teg_table_size
/* The numbers of all tables. */
static inline size_t teg_table_size(const teg_shape *s, int64_t n)
{
    return (size_t)s->bodies * (size_t)(n + 1) * (size_t)(teg_forms(s) + teg_coefficients(s)) * (size_t)(1 + s->order);
}

//: teg_room
/* An arrangement, and the arrays that it begins with. */
typedef struct {
    teg_arrangement r;
    teg_cell cells[16];
    teg_line lines[48];
    teg_region regions[32];
    TEG_ALIGNED double x[128], y[128], px[16], py[16], qx[16], qy[16], d[16];
    int label[128], pl[16], ql[16];
} teg_room;

//: teg_begin
/* Begin with the square and n candidates. */
static void teg_begin(teg_room *w, const teg_shape *shape, int64_t n, const double *rows)
{
    teg_arrangement *const r = &w->r;
    r->su = r->sv = r->nudge = r->parting = r->moving = r->u[0] = r->v[0] = 0.0;
    r->touching = r->concurrent = r->guarded = r->undefined = r->failed = r->tied = r->ambiguous = r->alone = r->last = r->places = 0;
    r->base = -1, r->cell_count = r->line_count = r->region_count = r->used = 0;
    r->bound_room = r->pending_room = r->twin_count = r->twin_room = 0, r->bounds = 0;
    r->bound = NULL, r->twins = NULL, r->pending = NULL;
    r->own_cells = r->own_lines = r->own_regions = r->own_pool = r->own_scratch = 0;
    r->shape = shape, r->rows = rows, r->n = n;
    r->cells = w->cells, r->cell_room = 16, r->lines = w->lines, r->line_room = 48, r->regions = w->regions, r->region_room = 32;
    r->x = w->x, r->y = w->y, r->label = w->label, r->pool_room = 128;
    r->px = w->px, r->py = w->py, r->qx = w->qx, r->qy = w->qy, r->d = w->d, r->pl = w->pl, r->ql = w->ql, r->scratch_room = 16;
    r->u[1] = r->v[1] = 1.0;
}

//: teg_end
/* Give back what has moved to the heap. */
static void teg_end(teg_arrangement *r)
{
    if (r->bound_room) free(r->bound);
    if (r->pending_room) free(r->pending);
    if (r->twin_room) free(r->twins);
    if (r->own_cells) free(r->cells);
    if (r->own_lines) free(r->lines);
    if (r->own_regions) free(r->regions);
    if (r->own_pool) free(r->x), free(r->y), free(r->label);
    if (r->own_scratch) free(r->px), free(r->py), free(r->qx), free(r->qy), free(r->d), free(r->pl), free(r->ql);
}

//: teg_nudge
/* How far keys are taken apart. */
static double teg_nudge(const teg_arrangement *r)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    double most = 0.0;
    for (int64_t k = 0; k < r->n; k++) {
        const double *const key = r->rows + k * teg_row(s) + teg_forms(s) - 3;
        most = teg_most_of(most, fabs(key[0]) + fabs(key[1]) + fabs(key[2]));
    }
    return TEG_NUDGE * most;
}

//: teg_moved_tables
/* The tables of a square with something on its sides, or with more equal keys at one place than have a second derivative there: the means of
   those of two squares that are moved a little, or whose keys are taken apart a little. Where candidates over one another end at one side
   there is a square for each of m colours, with the lines of this colour inside, and one without them whose weight is 2 - m. */
static void teg_moved_tables(teg_arrangement *r, const double *otherwise, double *tables)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const size_t size = teg_table_size(s, r->n), numbers = (size_t)r->n * (size_t)teg_row(s);
    const double shift = r->touching ? TEG_SHIFT : 0.0, *const rows = r->rows;
    const int concurrent = s->order && r->concurrent ? r->concurrent + r->touching + r->ambiguous : 0;
    const double nudge = concurrent ? teg_nudge(r) : 0.0;
    teg_side_line *lines = NULL;
    const size_t count = r->touching ? teg_find_side_lines(r, &lines) : 0, colours = lines ? teg_colour(r, lines, count) : 1;
    double *const moved = colours > 1 ? malloc(numbers * sizeof *moved) : NULL;
    if (moved) memcpy(moved, rows, numbers * sizeof *moved), r->rows = moved;
    else r->failed |= colours > 1;
    if (concurrent) r->ambiguous = concurrent > 1;
    for (size_t k = 0; k < size; k++) tables[k] = 0.0;
    for (size_t k = colours == 2; k <= colours && !r->failed; k++) {
        r->su = k == colours ? -shift : shift, r->sv = TEG_SKEW * r->su, r->nudge = k == colours ? -nudge : nudge, r->concurrent = 0;
        if (moved) teg_displace(r, lines, count, k, rows, moved);
        teg_tile(r, NULL, r->n * s->parts, 0, 0, otherwise, (double *const[]){NULL, NULL, tables});
        if (concurrent && r->concurrent) r->ambiguous = 1;
        for (size_t j = 0; !k && colours > 1 && j < size; j++) tables[j] *= 2.0 - (double)colours;
    }
    for (size_t k = 0; k < size; k++) tables[k] *= 0.5;
    r->rows = rows;
    free(moved);
    free(lines);
}

//: teg_no_slopes
/* Make all derivatives NaN but those by coefficients of the polynomials. */
static void teg_no_slopes(const teg_shape *s, int64_t n, double *tables)
{
    const int forms = teg_forms(s), columns = forms + teg_coefficients(s);
    for (size_t k = 0; k < teg_table_size(s, n); k++)
        if (s->order || (int)(k % (size_t)columns) < forms) tables[k] = NAN;
}

//: teg_tables
/* Add values, sizes (or NULL) and tables (or NULL, else 0 before) of an arrangement that was begun. */
static void teg_tables(teg_arrangement *r, const double *otherwise, double *values, double *sizes, double *tables)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const size_t size = teg_table_size(s, r->n);
    teg_tile(r, NULL, r->n * s->parts, 0, 0, otherwise, (double *const[]){values, sizes, tables});
    if (tables && teg_is_moved_later(r)) teg_moved_tables(r, otherwise, tables);
    for (size_t k = 0; tables && r->undefined && k < size; k++) tables[k] = NAN;
    if (tables && r->ambiguous) teg_no_slopes(s, r->n, tables);
}

//: teg_move_numbers
/* Numbers that are moved along the direction which follows them. */
static void teg_move_numbers(const double *from, int count, double step, double *to)
{
    for (int j = 0; j < count; j++) to[j] = from[j] + step * from[count + j], to[count + j] = from[count + j];
}

//: teg_parted_tables
/* Second derivatives in the tables of a square in which lines through one place part along the direction: the mean of both sides,
   2 M(h) - M(2h). */
static void teg_parted_tables(teg_arrangement *r, const double *otherwise, double *tables)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const size_t size = teg_table_size(s, r->n), columns = (size_t)(teg_forms(s) + teg_coefficients(s));
    const int row = teg_row(s), half = s->bodies * teg_coefficients(s);
    const double *const rows = r->rows, step = r->parting < TEG_SLOW * r->moving ? NAN : TEG_PARTING / r->parting, factors[4] = {1.0, -1.0, 2.0, -2.0};
    double *const moved = malloc(((size_t)r->n * (size_t)row + 2 * (size_t)half + 3 * size) * sizeof *moved);
    double *const rest = moved + (size_t)r->n * (size_t)row, *const found = rest + 2 * half, *const near = found + size, *const far = near + size;
    if (!moved) {
        r->failed = 1;
        return;
    }
    for (size_t k = 0; k < 2 * size; k++) near[k] = 0.0;
    for (int side = 0; side < 4 && !r->failed; side++) {
        double *const to = side < 2 ? near : far;
        for (int64_t k = 0; k < r->n; k++) teg_move_numbers(rows + k * row, row / 2, factors[side] * step, moved + k * row);
        teg_move_numbers(otherwise, half, factors[side] * step, rest);
        for (size_t k = 0; k < size; k++) found[k] = 0.0;
        r->rows = moved, r->su = r->sv = r->nudge = 0.0;
        r->touching = r->concurrent = r->undefined = r->ambiguous = r->places = 0;
        teg_tables(r, rest, NULL, NULL, found);
        for (size_t k = 0; k < size; k++) to[k] += 0.5 * found[k];
    }
    for (size_t first = 0; first < size; first += size / (size_t)s->bodies) {
        const size_t last = first + size / (size_t)s->bodies;
        double most = 0.0;
        for (size_t k = first; k < last; k++)
            if (k / columns % 2 == 0 && isfinite(near[k])) most = teg_most_of(most, fabs(near[k]));
        for (size_t k = first; k < last; k++)
            if (k / columns % 2 == 0 && !isnan(tables[k]))
                tables[k] = fabs(near[k] - far[k]) <= TEG_LIMIT * most ? 2.0 * near[k] - far[k] : NAN;
    }
    r->rows = rows;
    free(moved);
}

//: teg_cells
/* Values, sizes (or NULL) and tables (or NULL) of n candidates. Returns 1 without memory, else 0. */
static int teg_cells(
    const teg_shape *shape, int64_t n, const double *rows, const double *otherwise, double *values, double *sizes, double *tables)
{
    const teg_shape *const s = TEG_SHAPE(shape);
    const size_t size = teg_table_size(s, n);
    teg_room room;
    teg_arrangement *const r = &room.r;
    double *own = NULL;
    if (!s->order && (!n || (n == 1 && teg_covers(s, rows)))) {
        teg_one_owner(s, n, 0, n ? rows + teg_forms(s) : otherwise, values, sizes, tables);
        return 0;
    }
    teg_begin(&room, s, n, rows);
    for (int body = 0; body < s->bodies; body++) {
        values[body] = 0.0;
        if (sizes) sizes[body] = 0.0;
    }
    if (s->order && !tables) {
        own = tables = malloc(size * sizeof *own);
        if (!own) r->failed = 1;
    }
    if (!r->failed) {
        for (size_t k = 0; tables && k < size; k++) tables[k] = 0.0;
        teg_tables(r, otherwise, values, sizes, tables);
        for (int body = 0; body < s->bodies; body++) {
            if (r->undefined) values[body] = NAN;
            else if (s->order) values[body] = teg_along_direction(r, body, otherwise, tables + (size_t)body * size / (size_t)s->bodies);
        }
        if (s->order && r->parting > TEG_PARTED * r->moving && !own && !r->undefined && !r->failed) teg_parted_tables(r, otherwise, tables);
    }
    free(own);
    teg_end(r);
    return r->failed;
}

//: teg_is_known
/* Whether the polynomials of the owner of the first cell are finite. */
static int teg_is_known(const teg_shape *s, const double *f)
{
    int known = 1;
    for (int j = 0; j < s->bodies * teg_coefficients(s); j++) known &= isfinite(f[j]);
    return known;
}

//: teg_polynomials
/* The polynomials of an owner, or of the square outside of all candidates. */
static inline const double *teg_polynomials(const teg_arrangement *r, int64_t owner, const double *otherwise)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    return owner < 0 ? otherwise : r->rows + owner / s->parts * teg_row(s) + teg_forms(s);
}

//: teg_least
/* One more candidate for the least key; NaN where it is not known whether there is one, or its key. */
static inline void teg_least(double key, double present, int64_t index, double *least, double *winner)
{
    if (isnan(present) || isnan(*winner) || (present != 0.0 && isnan(key))) *winner = NAN;
    else if (present != 0.0 && (*winner < 0.0 || key < *least)) *least = key, *winner = (double)index;
}
