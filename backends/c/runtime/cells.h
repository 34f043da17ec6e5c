/* Integrals of the polynomial of the nearest candidate over the unit square, as teg.numerics.cells computes them. */

//: teg_shape
/* The numbers of one candidate, and the rules: `rule` has nodes r, s and weights on a triangle, `gauss` nodes and weights on (0, 1). */
typedef struct {
    int parts, guards, degree, order, bodies, nodes, points;
    const double *rule, *gauss;
} teg_shape;

//: teg_cell
/* A convex polygon: owner, number of corners, and where they begin in the pool, which has room for so many. */
typedef struct {
    int64_t owner;
    int n, room;
    size_t at;
} teg_cell;

//: teg_line
/* A line: its form divided by `size`; the candidates and the column of the numbers that it consists of (minus: -1 for none). */
typedef struct {
    double c, a, b, size;
    int64_t plus, minus;
    int column;
} teg_line;

//: teg_region
/* A part of a candidate that is inserted: its key in the middle, and its cutting lines, the first and one behind the last. */
typedef struct {
    double middle;
    int64_t region;
    int first, end;
} teg_region;

//: teg_arrangement
/* The cells of the square, moved by (su, sv), and all that they are made of. Arrays begin on the stack, and move to the heap as they grow. */
typedef struct {
    const teg_shape *shape;
    const double *rows;
    int64_t n;
    double su, sv;
    int forms, count, wide, row, touching, undefined, failed;
    int64_t base;
    teg_cell *cells;
    size_t cell_count, cell_room;
    teg_line *lines;
    size_t line_count, line_room;
    teg_region *regions;
    size_t region_count, region_room;
    double *x, *y, *d;
    int *label;
    size_t used, pool_room;
    double *px, *py, *qx, *qy;
    int *pl, *ql;
    size_t scratch_room;
    int own_cells, own_lines, own_regions, own_pool, own_scratch;
} teg_arrangement;

//: teg_grown
/* An array with more room: from the stack (own is 0) or from the heap. Sets `failed` where there is no memory. */
static void *teg_grown(void *array, int own, size_t used, size_t bytes, int *failed)
{
    void *more = own ? realloc(array, bytes) : malloc(bytes);
    if (!more) {
        *failed = 1;
        return array;
    }
    if (!own) memcpy(more, array, used);
    return more;
}

//: teg_room_in_pool
/* Make room for more corners in the pool. */
static int teg_room_in_pool(teg_arrangement *r, size_t more)
{
    if (r->used + more > r->pool_room) {
        const size_t room = 2 * (r->used + more), used = r->used * sizeof(double);
        r->x = teg_grown(r->x, r->own_pool, used, room * sizeof(double), &r->failed);
        if (r->failed) return 0;
        r->y = teg_grown(r->y, r->own_pool, used, room * sizeof(double), &r->failed);
        if (!r->failed) r->label = teg_grown(r->label, r->own_pool, r->used * sizeof(int), room * sizeof(int), &r->failed);
        if (r->failed) return 0;
        r->own_pool = 1;
        r->pool_room = room;
    }
    return 1;
}

//: teg_room_in_scratch
/* Make room for so many corners of the polygon that is being cut. */
static int teg_room_in_scratch(teg_arrangement *r, size_t most)
{
    if (most > r->scratch_room) {
        const size_t room = 2 * most, used = r->scratch_room * sizeof(double);
        double **const arrays[5] = {&r->px, &r->py, &r->qx, &r->qy, &r->d};
        for (int k = 0; k < 5; k++) {
            *arrays[k] = teg_grown(*arrays[k], r->own_scratch, used, room * sizeof(double), &r->failed);
            if (r->failed) return 0;
        }
        r->pl = teg_grown(r->pl, r->own_scratch, r->scratch_room * sizeof(int), room * sizeof(int), &r->failed);
        if (!r->failed) r->ql = teg_grown(r->ql, r->own_scratch, r->scratch_room * sizeof(int), room * sizeof(int), &r->failed);
        if (r->failed) return 0;
        r->own_scratch = 1;
        r->scratch_room = room;
    }
    return 1;
}

//: teg_add_line
/* One more line; returns its number. */
static int teg_add_line(teg_arrangement *r, teg_line line)
{
    if (r->line_count == r->line_room) {
        r->lines = teg_grown(r->lines, r->own_lines, r->line_count * sizeof line, 2 * r->line_room * sizeof line, &r->failed);
        if (r->failed) return 0;
        r->own_lines = 1;
        r->line_room *= 2;
    }
    r->lines[r->line_count] = line;
    return (int)r->line_count++;
}

//: teg_add_cell
/* One more cell, the polygon in these arrays. */
static void teg_add_cell(teg_arrangement *r, int64_t owner, int n, const double *x, const double *y, const int *label)
{
    teg_cell cell = {owner, n, n, r->used};
    if (!teg_room_in_pool(r, (size_t)n)) return;
    if (r->cell_count == r->cell_room) {
        r->cells = teg_grown(r->cells, r->own_cells, r->cell_count * sizeof cell, 2 * r->cell_room * sizeof cell, &r->failed);
        if (r->failed) return;
        r->own_cells = 1;
        r->cell_room *= 2;
    }
    memcpy(r->x + r->used, x, (size_t)n * sizeof *x);
    memcpy(r->y + r->used, y, (size_t)n * sizeof *y);
    memcpy(r->label + r->used, label, (size_t)n * sizeof *label);
    r->used += (size_t)n;
    r->cells[r->cell_count++] = cell;
}

//: teg_form
/* A form of a candidate in the coordinates of the square. */
static inline void teg_form(const teg_arrangement *r, int64_t candidate, int column, double *g)
{
    const double *const f = r->rows + candidate * r->row + column;
    g[0] = f[0] + f[1] * r->su + f[2] * r->sv, g[1] = f[1], g[2] = f[2];
}

//: teg_half
/* The part of a polygon on one side of a line, on which its corners have the values d; returns the number of its corners. */
static int teg_half(int n, const double *x, const double *y, const int *label, const double *d, double side, int cut, double *u, double *v, int *l)
{
    int q = 0;
    for (int i = 0; i < n; i++) {
        const int j = i + 1 == n ? 0 : i + 1;
        const double di = side * d[i], dj = side * d[j];
        if (di >= 0.0) u[q] = x[i], v[q] = y[i], l[q++] = di == 0.0 && dj < 0.0 ? cut : label[i];
        if (di * dj < 0.0) {
            const double t = d[i] / (d[i] - d[j]);
            u[q] = x[i] + t * (x[j] - x[i]), v[q] = y[i] + t * (y[j] - y[i]), l[q++] = di > 0.0 ? cut : label[i];
        }
    }
    return q;
}

//: teg_on_side
/* Whether an edge of a polygon on a side of the square has 0 (to a tolerance) at both ends. */
static int teg_on_side(int n, const int *label, const double *d, double tolerance)
{
    for (int i = 0; i < n; i++)
        if (label[i] < 8 && fabs(d[i]) <= tolerance && fabs(d[i + 1 == n ? 0 : i + 1]) <= tolerance) return 1;
    return 0;
}

//: teg_clip_cell
/* Give a region its part of a cell; what is cut off stays with the owner. `extra`: one more line, or -1. */
static void teg_clip_cell(teg_arrangement *r, size_t number, const teg_region *region, int extra)
{
    const teg_cell cell = r->cells[number];
    const size_t cells = r->cell_count, used = r->used;
    int n = cell.n;
    if (!teg_room_in_scratch(r, (size_t)n + 2)) return;
    memcpy(r->px, r->x + cell.at, (size_t)n * sizeof(double));
    memcpy(r->py, r->y + cell.at, (size_t)n * sizeof(double));
    memcpy(r->pl, r->label + cell.at, (size_t)n * sizeof(int));
    for (int line = region->first; line < region->end + (extra >= 0); line++) {
        const int k = line < region->end ? line : extra;
        const teg_line g = r->lines[k];
        int above = 0, below = 0, m;
        double *swap;
        int *labels;
        if (!teg_room_in_scratch(r, (size_t)n + 2)) return;
        for (int i = 0; i < n; i++) {
            const double d = g.c + g.a * r->px[i] + g.b * r->py[i];
            r->d[i] = fabs(d) < TEG_ON_LINE ? 0.0 : d;
            above += r->d[i] > 0.0, below += r->d[i] < 0.0;
        }
        if (!above || !below) {
            r->touching |= teg_on_side(n, r->pl, r->d, 0.0);
            if (above) continue;
            r->cell_count = cells, r->used = used;
            return;
        }
        m = teg_half(n, r->px, r->py, r->pl, r->d, -1.0, 2 * k + 1, r->qx, r->qy, r->ql);
        teg_add_cell(r, cell.owner, m, r->qx, r->qy, r->ql);
        n = teg_half(n, r->px, r->py, r->pl, r->d, 1.0, 2 * k, r->qx, r->qy, r->ql);
        if (r->failed) return;
        swap = r->px, r->px = r->qx, r->qx = swap;
        swap = r->py, r->py = r->qy, r->qy = swap;
        labels = r->pl, r->pl = r->ql, r->ql = labels;
    }
    if (n > cell.room) {
        if (!teg_room_in_pool(r, (size_t)n)) return;
        r->cells[number].at = r->used, r->cells[number].room = n;
        r->used += (size_t)n;
    }
    r->cells[number].owner = region->region, r->cells[number].n = n;
    memcpy(r->x + r->cells[number].at, r->px, (size_t)n * sizeof(double));
    memcpy(r->y + r->cells[number].at, r->py, (size_t)n * sizeof(double));
    memcpy(r->label + r->cells[number].at, r->pl, (size_t)n * sizeof(int));
}

//: teg_key_line
/* The line on which the keys of two candidates are equal, of the form g, which is positive where the second one is nearer. */
static int teg_key_line(teg_arrangement *r, int64_t owner, int64_t candidate, const double *g)
{
    const double size = sqrt(g[1] * g[1] + g[2] * g[2]);
    const teg_line line = {g[0] / size, g[1] / size, g[2] / size, size, owner, candidate, r->forms - 3};
    for (size_t k = r->line_count; k-- > 4;)
        if (r->lines[k].minus == candidate && r->lines[k].plus == owner) return (int)k;
    return teg_add_line(r, line);
}

//: teg_key_difference
/* key - key; returns the value below which it counts as 0. */
static double teg_key_difference(const teg_arrangement *r, int64_t behind, int64_t before, double *g)
{
    double f[3];
    const int column = r->forms - 3;
    teg_form(r, behind, column, g);
    teg_form(r, before, column, f);
    const double constant = fmax(fabs(g[0]), fabs(f[0]));
    g[0] -= f[0], g[1] -= f[1], g[2] -= f[2];
    return TEG_ON_LINE * sqrt(g[1] * g[1] + g[2] * g[2]) + TEG_KEY_ROUNDING * constant;
}

//: teg_insert
/* One more region. */
static void teg_insert(teg_arrangement *r, const teg_region *region)
{
    const size_t cells = r->cell_count;
    const int parts = r->shape->parts;
    for (size_t k = 0; k < cells && !r->failed; k++) {
        const teg_cell cell = r->cells[k];
        int extra = -1;
        if (cell.owner >= 0) {
            double g[3], most = -INFINITY, least = INFINITY, tolerance;
            if (cell.owner / parts == region->region / parts) continue;
            if (!teg_room_in_scratch(r, (size_t)cell.n + 2)) return;
            tolerance = teg_key_difference(r, cell.owner / parts, region->region / parts, g);
            for (int i = 0; i < cell.n; i++) {
                const double d = r->d[i] = g[0] + g[1] * r->x[cell.at + i] + g[2] * r->y[cell.at + i];
                most = fmax(most, d), least = fmin(least, d);
            }
            if ((most > tolerance) != (least < -tolerance)) r->touching |= teg_on_side(cell.n, r->label + cell.at, r->d, tolerance);
            if (most <= tolerance && (least < -tolerance || region->region > cell.owner)) continue;
            if (most > tolerance && least < -tolerance) extra = teg_key_line(r, cell.owner / parts, region->region / parts, g);
        }
        teg_clip_cell(r, k, region, extra);
    }
}

//: teg_present
/* Whether a region may be in the square; if so its cutting lines are added. */
static int teg_present(teg_arrangement *r, teg_region *region)
{
    const teg_shape *const s = r->shape;
    const int64_t candidate = region->region / s->parts;
    const size_t before = r->line_count;
    int finite = 1;
    region->first = (int)before;
    for (int q = 0; q < s->guards; q++) {
        const int column = 3 * ((int)(region->region % s->parts) * s->guards + q);
        double g[3], size;
        teg_form(r, candidate, column, g);
        size = sqrt(g[1] * g[1] + g[2] * g[2]);
        if (g[0] + fmax(g[1], 0.0) + fmax(g[2], 0.0) < -TEG_ON_LINE * size || (size == 0.0 && g[0] < 0.0)) {
            r->line_count = before;
            return 0;
        }
        finite &= isfinite(g[0]) && isfinite(g[1]) && isfinite(g[2]);
        if (finite && g[0] + fmin(g[1], 0.0) + fmin(g[2], 0.0) <= TEG_ON_LINE * size && size > 0.0) {
            const teg_line line = {g[0] / size, g[1] / size, g[2] / size, size, candidate, -1, column};
            teg_add_line(r, line);
        }
    }
    region->end = (int)r->line_count;
    r->undefined |= !finite;
    return 1;
}

//: teg_by_middle
static int teg_by_middle(const void *a, const void *b)
{
    const teg_region *const p = a, *const q = b;
    return p->middle < q->middle ? -1 : p->middle > q->middle ? 1 : p->region < q->region ? -1 : p->region > q->region;
}

//: teg_arrange
/* Cut the square into cells. */
static void teg_arrange(teg_arrangement *r, double su, double sv)
{
    static const teg_line sides[4] = {{0, 1, 0, 1, -1, -1, 0}, {1, -1, 0, 1, -1, -1, 0}, {0, 0, 1, 1, -1, -1, 0}, {1, 0, -1, 1, -1, -1, 0}};
    static const double x[4] = {0, 1, 1, 0}, y[4] = {0, 0, 1, 1};
    static const int label[4] = {4, 2, 6, 0};
    const int64_t regions = r->n * r->shape->parts;
    int64_t base = -1;
    double nearest = INFINITY;
    size_t kept = 0;
    r->su = su, r->sv = sv;
    r->touching = r->undefined = 0;
    r->cell_count = r->line_count = r->region_count = r->used = 0;
    for (int k = 0; k < 4; k++) teg_add_line(r, sides[k]);
    for (int64_t k = 0; k < regions && !r->undefined && !r->failed; k++) {
        teg_region region = {0.0, k, 0, 0};
        double g[3];
        if (!teg_present(r, &region)) continue;
        if (r->region_count == r->region_room) {
            r->regions =
                teg_grown(r->regions, r->own_regions, r->region_count * sizeof region, 2 * r->region_room * sizeof region, &r->failed);
            if (r->failed) return;
            r->own_regions = 1;
            r->region_room *= 2;
        }
        teg_form(r, k / r->shape->parts, r->forms - 3, g);
        r->undefined |= !isfinite(g[0]) || !isfinite(g[1]) || !isfinite(g[2]);
        region.middle = g[0] + 0.5 * g[1] + 0.5 * g[2];
        if (region.first == region.end && (base < 0 || g[0] + fmax(g[1], 0.0) + fmax(g[2], 0.0) < nearest))
            base = k, nearest = g[0] + fmax(g[1], 0.0) + fmax(g[2], 0.0);
        r->regions[r->region_count++] = region;
    }
    r->base = base;
    if (r->undefined) return;
    teg_add_cell(r, base, 4, x, y, label);
    for (size_t k = 0; k < r->region_count && base >= 0; k++) {
        double g[3];
        if (r->regions[k].region == base) continue;
        const double tolerance = teg_key_difference(r, r->regions[k].region / r->shape->parts, base / r->shape->parts, g);
        if (g[0] + fmin(g[1], 0.0) + fmin(g[2], 0.0) > tolerance) continue;
        r->regions[kept++] = r->regions[k];
    }
    if (base >= 0) r->region_count = kept;
    qsort(r->regions, r->region_count, sizeof *r->regions, teg_by_middle);
    for (size_t k = 0; k < r->region_count && !r->failed; k++) teg_insert(r, r->regions + k);
}

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
    g[0] = g[1] = g[2] = 0.0;
    for (int k = 0; k < 2; k++) {
        const int64_t candidate = k ? line->minus : line->plus;
        if (candidate >= 0) {
            const double *const f = r->rows + candidate * r->row + r->wide + line->column;
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

//: teg_cell_moments
/* Add the moments of a cell, and their derivatives along the direction (`dm` may be NULL). */
static void teg_cell_moments(const teg_arrangement *r, const teg_cell *cell, const double *p, const double *q, double *m, double *dm)
{
    const teg_shape *const s = r->shape;
    const double *const x = r->x + cell->at, *const y = r->y + cell->at;
    double at[TEG_MONOMIALS], slope[TEG_MONOMIALS];
    for (int k = 1; k + 1 < cell->n; k++) {
        const double a = x[k] - x[0], b = y[k] - y[0], c = x[k + 1] - x[0], d = y[k + 1] - y[0], area = 0.5 * (a * d - c * b);
        for (int node = 0; node < s->nodes; node++) {
            const double t = s->rule[3 * node], u = s->rule[3 * node + 1], w = s->rule[3 * node + 2] * area;
            const double px = x[0] + t * a + u * c, py = y[0] + t * b + u * d;
            if (dm) {
                const double e = p[k] - p[0], f = q[k] - q[0], g = p[k + 1] - p[0], h = q[k + 1] - q[0];
                const double growth = 0.5 * (e * d + a * h - g * b - c * f) * s->rule[3 * node + 2];
                teg_monomials(px, py, p[0] + t * e + u * g, q[0] + t * f + u * h, s->degree, at, slope);
                for (int j = 0; j < r->count; j++) dm[j] += growth * at[j] + w * slope[j];
            } else
                teg_monomials(px, py, 0.0, 0.0, s->degree, at, NULL);
            for (int j = 0; j < r->count; j++) m[j] += w * at[j];
        }
    }
}

//: teg_cell_edges
/* Add what the edges of a cell give to the derivatives of all values. `own` and `base` have the polynomials of its owner and of the owner
   of the cells that are left out (or NULL), `change` and `base_change` the directions of these, all four in `polynomials`. */
static void teg_cell_edges(
    const teg_arrangement *r, const teg_cell *cell, const double *p, const double *q, const double *const *polynomials, double *tables)
{
    const teg_shape *const s = r->shape;
    const double *const own = polynomials[0], *const change = polynomials[1], *const base = polynomials[2], *const base_change = polynomials[3];
    const int columns = r->forms + r->count, width = columns * (1 + s->order), count = r->count;
    double at[TEG_MONOMIALS], slope[TEG_MONOMIALS];
    for (int i = 0; i < cell->n; i++) {
        const int label = r->label[cell->at + i], j = i + 1 == cell->n ? 0 : i + 1;
        const teg_line *const line = r->lines + (label >> 1);
        const double x0 = r->x[cell->at + i], y0 = r->y[cell->at + i], dx = r->x[cell->at + j] - x0, dy = r->y[cell->at + j] - y0;
        double length, scale, g[3], stretch = 0.0;
        if (label < 8) continue;
        length = sqrt(dx * dx + dy * dy), scale = (label & 1 ? -length : length) / line->size;
        if (s->order) {
            teg_rate(r, line, g);
            if (length > 0.0) stretch = (dx * (p[j] - p[i]) + dy * (q[j] - q[i])) / (length * length);
            stretch -= line->a * g[1] + line->b * g[2];
        }
        for (int point = 0; point < s->points; point++) {
            const double t = s->gauss[2 * point], h = scale * s->gauss[2 * point + 1], x = x0 + t * dx, y = y0 + t * dy;
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
                value *= h, moved = h * moved + value * stretch;
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

//: teg_from_moments
/* Add what the moments of an owner give to values, sizes and tables, each NULL if it is not wanted. */
static void teg_from_moments(
    const teg_arrangement *r, int64_t row, const double *f, const double *m, const double *dm, double *const *wanted)
{
    const teg_shape *const s = r->shape;
    const int columns = r->forms + r->count, width = columns * (1 + s->order);
    for (int body = 0; body < s->bodies; body++) {
        const double *const own = f + body * r->count;
        double value = 0.0, size = 0.0;
        for (int j = 0; j < r->count; j++) value += own[j] * m[j], size += fabs(own[j]);
        if (wanted[0]) wanted[0][body] += value;
        if (wanted[1]) wanted[1][body] += m[0] * size;
        if (wanted[2]) {
            double *const at = wanted[2] + body * (r->n + 1) * width + row * width + r->forms;
            for (int j = 0; j < r->count; j++) {
                at[j] += s->order ? dm[j] : m[j];
                if (s->order) at[columns + j] += m[j];
            }
        }
    }
}

//: teg_measure
/* Add values, sizes and tables of an arrangement, each NULL if it is not wanted. The cells of the owner of the first one are left out: its
   moments are those of the square without the others', and its polynomial is subtracted from theirs. */
static void teg_measure(teg_arrangement *r, const double *otherwise, double *values, double *sizes, double *tables)
{
    const teg_shape *const s = r->shape;
    const int half = s->bodies * r->count;
    const int64_t base = r->base, base_row = base < 0 ? r->n : base / s->parts;
    const double *const f = base < 0 ? otherwise : r->rows + base_row * r->row + r->forms;
    const double *const df = base < 0 ? otherwise + half : r->rows + base_row * r->row + r->wide + r->forms;
    double m[TEG_MONOMIALS], dm[TEG_MONOMIALS], rest[TEG_MONOMIALS], change[TEG_MONOMIALS], *const wanted[3] = {values, sizes, tables};
    const int whole = r->cell_count == 1 && r->cells[0].owner == base;
    int known = 1;
    if (r->undefined) return;
    for (int j = 0; j < half; j++) known &= isfinite(f[j]) && (!s->order || isfinite(df[j]));
    for (int total = 0, at = 0; total <= s->degree; total++)
        for (int j = 0; j <= total; j++, at++) rest[at] = 1.0 / ((total - j + 1.0) * (j + 1.0)), change[at] = 0.0;
    for (size_t k = 0; k < r->cell_count && !whole; k++) {
        const teg_cell *const cell = r->cells + k;
        const int64_t row = cell->owner < 0 ? r->n : cell->owner / s->parts;
        const double *const own = cell->owner < 0 ? otherwise : r->rows + row * r->row + r->forms;
        const double *const moving = cell->owner < 0 ? otherwise + half : r->rows + row * r->row + r->wide + r->forms;
        const double *const polynomials[4] = {own, moving, known ? f : NULL, known ? df : NULL};
        if (known && cell->owner == base) continue;
        for (int j = 0; j < r->count; j++) m[j] = dm[j] = 0.0;
        if (s->order) {
            if (!teg_room_in_scratch(r, (size_t)cell->n + 2)) return;
            teg_velocities(r, cell, r->px, r->py);
        }
        teg_cell_moments(r, cell, r->px, r->py, m, s->order ? dm : NULL);
        for (int j = 0; j < r->count; j++) rest[j] -= m[j], change[j] -= dm[j];
        teg_from_moments(r, row, own, m, dm, wanted);
        if (tables) teg_cell_edges(r, cell, r->px, r->py, polynomials, tables);
    }
    if (known || whole) teg_from_moments(r, base_row, f, rest, change, wanted);
}

//: teg_along_direction
/* The derivative of one value along the direction, from its table. */
static double teg_along_direction(const teg_arrangement *r, int body, const double *otherwise, const double *table)
{
    const int columns = r->forms + r->count, first = r->forms + body * r->count;
    const double *const last = table + r->n * 2 * columns + columns + r->forms, *const d = otherwise + (r->shape->bodies + body) * r->count;
    double total = 0.0;
    for (int64_t k = 0; k < r->n; k++) {
        const double *const own = table + k * 2 * columns + columns, *const moving = r->rows + k * r->row + r->wide;
        for (int j = 0; j < columns; j++) {
            if (own[j] != 0.0) total += moving[j < r->forms ? j : first + j - r->forms] * own[j];
        }
    }
    for (int j = 0; j < r->count; j++)
        if (last[j] != 0.0) total += d[j] * last[j];
    return total;
}

//: teg_cells
/* Values, sizes (or NULL) and tables (or NULL) of n candidates. Returns 1 without memory, else 0. */
static int teg_cells(
    const teg_shape *s, int64_t n, const double *rows, const double *otherwise, double *values, double *sizes, double *tables)
{
    teg_cell cells[16];
    teg_line lines[48];
    teg_region regions[32];
    double x[128], y[128], px[16], py[16], qx[16], qy[16], d[16];
    int label[128], pl[16], ql[16];
    teg_arrangement r;
    const int count = (s->degree + 1) * (s->degree + 2) / 2, forms = 3 * s->parts * s->guards + 3, wide = forms + s->bodies * count;
    const size_t size = (size_t)s->bodies * (size_t)(n + 1) * (size_t)(forms + count) * (size_t)(1 + s->order);
    double *own = NULL;
    memset(&r, 0, sizeof r);
    r.shape = s, r.rows = rows, r.n = n, r.count = count, r.forms = forms, r.wide = wide, r.row = wide * (1 + s->order);
    r.cells = cells, r.cell_room = 16, r.lines = lines, r.line_room = 48, r.regions = regions, r.region_room = 32;
    r.x = x, r.y = y, r.label = label, r.pool_room = 128;
    r.px = px, r.py = py, r.qx = qx, r.qy = qy, r.d = d, r.pl = pl, r.ql = ql, r.scratch_room = 16;
    teg_arrange(&r, 0.0, 0.0);
    for (int body = 0; body < s->bodies; body++) {
        values[body] = 0.0;
        if (sizes) sizes[body] = 0.0;
    }
    if (s->order && !tables) {
        own = tables = malloc(size * sizeof *own);
        if (!own) r.failed = 1;
    }
    if (!r.failed) {
        const int touching = r.touching;
        if (tables)
            for (size_t k = 0; k < size; k++) tables[k] = r.undefined ? NAN : 0.0;
        teg_measure(&r, otherwise, values, sizes, tables && !touching ? tables : NULL);
        if (tables && touching) {
            for (int k = 0; k < 2 && !r.failed; k++) {
                const double shift = k ? -TEG_SHIFT : TEG_SHIFT;
                teg_arrange(&r, shift, TEG_SKEW * shift);
                if (!r.failed) teg_measure(&r, otherwise, NULL, NULL, tables);
            }
            for (size_t k = 0; k < size; k++) tables[k] *= 0.5;
        }
        for (int body = 0; body < s->bodies; body++) {
            if (r.undefined) values[body] = NAN;
            else if (s->order) values[body] = teg_along_direction(&r, body, otherwise, tables + (size_t)body * size / (size_t)s->bodies);
        }
    }
    free(own);
    if (r.own_cells) free(r.cells);
    if (r.own_lines) free(r.lines);
    if (r.own_regions) free(r.regions);
    if (r.own_pool) free(r.x), free(r.y), free(r.label);
    if (r.own_scratch) free(r.px), free(r.py), free(r.qx), free(r.qy), free(r.d), free(r.pl), free(r.ql);
    return r.failed;
}

//: teg_least
/* One more candidate for the least key; NaN where it is not known whether there is one, or its key. */
static inline void teg_least(double key, double present, int64_t index, double *least, double *winner)
{
    if (isnan(present) || isnan(*winner) || (present != 0.0 && isnan(key))) *winner = NAN;
    else if (present != 0.0 && (*winner < 0.0 || key < *least)) *least = key, *winner = (double)index;
}
