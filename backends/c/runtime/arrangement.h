/* Convex cells of the unit square, each with the candidate that is nearest there, as teg.numerics.cells makes them. */

//: teg_shape
/* The numbers of one candidate, and the rules: `rule` has nodes r, s and weights on a triangle, `gauss` nodes and weights on (0, 1). */
typedef struct {
    int parts, guards, degree, order, bodies, nodes, points;
    const double *rule, *gauss;
} teg_shape;

//: TEG_SHAPE
/* The shape itself; in programs with one shape its name is given here, so that its numbers are constants for the C compiler. */
#ifndef TEG_SHAPE
#define TEG_SHAPE(shape) (shape)
#endif

//: teg_coefficients
/* The number of coefficients of a polynomial. */
static inline int teg_coefficients(const teg_shape *s)
{
    return (s->degree + 1) * (s->degree + 2) / 2;
}

//: teg_forms
/* The numbers of the guards and the key of a candidate. */
static inline int teg_forms(const teg_shape *s)
{
    return 3 * s->parts * s->guards + 3;
}

//: teg_wide
/* All numbers of a candidate, without their direction. */
static inline int teg_wide(const teg_shape *s)
{
    return teg_forms(s) + s->bodies * teg_coefficients(s);
}

//: teg_row
/* All numbers of a candidate. */
static inline int64_t teg_row(const teg_shape *s)
{
    return teg_wide(s) * (1 + s->order);
}

//: teg_cell
/* A convex polygon: owner, number of corners, and where they begin in the pool, which has room for so many; and the cut that made it: its
   line, and what became of the sides g >= 0 and g <= 0. These are cells (~k) or further cuts (k, the cut that made cell k). `up` is where
   the cell itself is named: twice the cut, + 1 on the side g <= 0. Cell 0 was made by no cut: its first side is the whole square. Integrals
   over it count `weight` times, which is 1 but in cells with signs. */
typedef struct {
    int64_t owner;
    size_t at;
    int n, room, line, up, sides[2];
    double weight;
} teg_cell;

//: teg_line
/* A line: its form divided by `size`; the candidates and the column of the numbers that it consists of (minus: -1 for none); for a guard
   the lines of its region, the first and one behind the last; where it is among the twins, or -1; and whether its edges had another line
   before (`late`), so that it is not known how their ends move. */
typedef struct {
    double c, a, b, size;
    int64_t plus, minus;
    int column, first, end, twin, late;
} teg_line;

//: teg_twin
/* A guard's line, turned so that those of different regions that are one line have the same angle (the tangent of half of it) and distance;
   `rank` is the place of its region, the nearest one first. */
typedef struct {
    double angle, c, sign;
    int rank, line;
} teg_twin;

//: teg_region
/* A part of a candidate that is inserted: its key in the middle, which guards have lines that cut the tile, as bits, and these lines, the
   first and one behind the last. */
typedef struct {
    double middle;
    int64_t region;
    int first, end;
    unsigned cuts;
} teg_region;

//: teg_arrangement
/* The cells of a tile of the square, from (u[0], v[0]) to (u[1], v[1]), moved by (su, sv), and all that they are made of. Arrays begin on the
   stack, and move to the heap as they grow. `nudge`: how far keys are taken apart; `guarded`: guards have lines in the square; `tied`: something
   else has the line of an edge on which two keys are equal; `ambiguous`: such an edge has no derivative; `concurrent`: more keys are equal at
   one place than have a second derivative there, 2 if it has no two sides; `alone`: it is known that no two regions have one line; `last`:
   the last region is being inserted, and cells of the base need not be there. */
typedef struct {
    const teg_shape *shape;
    const double *rows;
    int64_t n;
    double su, sv, nudge, u[2], v[2];
    int touching, concurrent, guarded, undefined, failed, tied, ambiguous, alone, last;
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
    size_t scratch_room, bound_room, pending_room;
    double *bound;
    teg_twin *twins;
    size_t twin_count, twin_room;
    int *pending, bounds;
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
/* Make room for more corners in the pool, or for a piece. */
static int teg_room_in_pool(teg_arrangement *r, size_t more)
{
    more = more < TEG_PIECE ? TEG_PIECE : more;
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
/* One more line, whose form g has this size; the other numbers of it are those of a line on which two keys are equal. Returns its number. */
static int teg_add_line(teg_arrangement *r, const double *g, double size, int64_t plus, int64_t minus, int column)
{
    teg_line *line;
    if (r->line_count == r->line_room) {
        r->lines = teg_grown(r->lines, r->own_lines, r->line_count * sizeof *line, 2 * r->line_room * sizeof *line, &r->failed);
        if (r->failed) return 0;
        r->own_lines = 1;
        r->line_room *= 2;
    }
    line = r->lines + r->line_count;
    line->c = g[0] / size, line->a = g[1] / size, line->b = g[2] / size, line->size = size;
    line->plus = plus, line->minus = minus, line->column = column;
    line->first = line->end = line->late = 0, line->twin = -1;
    return (int)r->line_count++;
}

//: teg_new_cell
/* One more cell, whose corners are the next n of the pool. Those of few corners are pieces (see `teg_piece`). */
static void teg_new_cell(teg_arrangement *r, int64_t owner, int line, int n)
{
    const int number = (int)r->cell_count, room = n < TEG_PIECE ? TEG_PIECE : n;
    teg_cell *cell;
    if (r->cell_count == r->cell_room) {
        r->cells = teg_grown(r->cells, r->own_cells, r->cell_count * sizeof *cell, 2 * r->cell_room * sizeof *cell, &r->failed);
        if (r->failed) return;
        r->own_cells = 1;
        r->cell_room *= 2;
    }
    cell = r->cells + r->cell_count++;
    cell->owner = owner, cell->at = r->used, cell->n = n, cell->room = room, cell->line = line, cell->up = 2 * number + 1;
    cell->sides[0] = 0, cell->sides[1] = ~number, cell->weight = 1.0;
    r->used += (size_t)room;
}

//: teg_cell_of
/* One more cell, which is a piece. */
static inline void teg_cell_of(teg_arrangement *r, const teg_piece *piece, int64_t owner)
{
    if (!teg_room_in_pool(r, TEG_PIECE)) return;
    memcpy(r->x + r->used, piece->x, sizeof piece->x);
    memcpy(r->y + r->used, piece->y, sizeof piece->y);
    memcpy(r->label + r->used, piece->label, sizeof piece->label);
    teg_new_cell(r, owner, 0, piece->n);
}

//: teg_form
/* A form of a candidate in the coordinates of the square. */
static inline void teg_form(const teg_arrangement *r, int64_t candidate, int column, double *g)
{
    const double *const f = r->rows + candidate * teg_row(TEG_SHAPE(r->shape)) + column;
    g[0] = f[0] + f[1] * r->su + f[2] * r->sv, g[1] = f[1], g[2] = f[2];
}

//: teg_key_form
/* The key of a candidate in the coordinates of the square. What is added to take keys apart has no order, so that no few of them cancel. */
static inline void teg_key_form(const teg_arrangement *r, int64_t candidate, double *g)
{
    teg_form(r, candidate, teg_forms(TEG_SHAPE(r->shape)) - 3, g);
    if (TEG_SHAPE(r->shape)->order && r->nudge != 0.0) {
        uint32_t h = (uint32_t)candidate * 2654435761u;
        h = (h ^ h >> 15) * 2246822519u;
        g[0] += r->nudge * ((h ^ h >> 13) / 2147483648.0 - 1.0);
    }
}

//: teg_least_of
static inline double teg_least_of(double x, double y)
{
    return x < y ? x : y;
}

//: teg_most_of
static inline double teg_most_of(double x, double y)
{
    return x > y ? x : y;
}

//: teg_highest
/* The largest value of a form on the tile. */
static inline double teg_highest(const teg_arrangement *r, const double *g)
{
    return g[0] + teg_most_of(g[1] * r->u[0], g[1] * r->u[1]) + teg_most_of(g[2] * r->v[0], g[2] * r->v[1]);
}

//: teg_lowest
/* The least value of a form on the tile. */
static inline double teg_lowest(const teg_arrangement *r, const double *g)
{
    return g[0] + teg_least_of(g[1] * r->u[0], g[1] * r->u[1]) + teg_least_of(g[2] * r->v[0], g[2] * r->v[1]);
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

//: teg_split
/* Cut a polygon by line k, on which its corners have the values d: into the part where the line's form is >= 0, which goes to u, v, l, and the
   part where it is <= 0. Returns the number of corners of the first; *below that of the other. Both have the same points on the line. */
static inline int teg_split(int n, const double *x, const double *y, const int *label, const double *d, int k, double *u, double *v, int *l,
    double *p, double *q, int *m, int *below)
{
    int a = 0, b = 0;
    for (int i = 0; i < n; i++) {
        const int j = i + 1 == n ? 0 : i + 1;
        const double di = d[i], dj = d[j];
        if (di >= 0.0) u[a] = x[i], v[a] = y[i], l[a++] = di == 0.0 && dj < 0.0 ? 2 * k : label[i];
        if (di <= 0.0) p[b] = x[i], q[b] = y[i], m[b++] = di == 0.0 && dj > 0.0 ? 2 * k + 1 : label[i];
        if (di * dj < 0.0) {
            const double t = di / (di - dj), s = x[i] + t * (x[j] - x[i]), w = y[i] + t * (y[j] - y[i]);
            u[a] = s, v[a] = w, l[a++] = di > 0.0 ? 2 * k : label[i];
            p[b] = s, q[b] = w, m[b++] = di < 0.0 ? 2 * k + 1 : label[i];
        }
    }
    *below = b;
    return a;
}

//: teg_is_at
/* Whether a region is at a straight line from (x, y) to (u, v), or not farther than TEG_BESIDE from it. */
static int teg_is_at(const teg_arrangement *r, const teg_region *region, double x, double y, double u, double v)
{
    double first = 0.0, last = 1.0;
    for (int k = region->first; k < region->end; k++) {
        const teg_line *const g = r->lines + k;
        const double d = g->c + TEG_BESIDE + g->a * x + g->b * y, e = g->c + TEG_BESIDE + g->a * u + g->b * v;
        if (d < 0.0 && e < 0.0) return 0;
        if (d < 0.0) first = fmax(first, d / (d - e));
        else if (e < 0.0) last = fmin(last, d / (d - e));
    }
    return first <= last;
}

//: teg_touch
/* Note whether a region is at an edge of a polygon on a side of the square where d is 0 (to a tolerance) at both ends, and whether an edge on
   which two keys are equal is there. */
static void teg_touch(
    teg_arrangement *r, const teg_region *region, int n, const double *x, const double *y, const int *label, double tolerance)
{
    for (int i = 0; i < n; i++) {
        const int j = i + 1 == n ? 0 : i + 1;
        if (fabs(r->d[i]) > tolerance || fabs(r->d[j]) > tolerance) continue;
        if (label[i] < 8) r->touching = r->touching || teg_is_at(r, region, x[i], y[i], x[j], y[j]);
        else r->tied |= r->lines[label[i] >> 1].minus >= 0;
    }
}

//: teg_hang
/* Put what was cut off a cell, the first of these cells and all behind it, into the tree of cuts. */
static inline void teg_hang(teg_arrangement *r, size_t number, size_t first)
{
    for (size_t k = first; k < r->cell_count; k++) {
        const int up = r->cells[number].up;
        r->cells[up >> 1].sides[up & 1] = (int)k;
        r->cells[k].sides[0] = ~(int)number;
        r->cells[number].up = 2 * (int)k;
    }
}

//: teg_clip_piece
/* `teg_clip_cell` of a cell that is a piece. Returns 0, and changes nothing, where a corner lies on a line or there are too many. What the
   last region cuts off the base's cells is left out if it need not be there. */
static int teg_clip_piece(teg_arrangement *r, size_t number, const teg_region *region, int extra)
{
    const size_t cells = r->cell_count, used = r->used, at = r->cells[number].at;
    const int64_t owner = r->cells[number].owner;
    const unsigned all = (1u << TEG_PIECE) - 1;
    const double *x = r->x + at, *y = r->y + at;
    const int *label = r->label + at;
    teg_piece parts[2];
    const int spare = r->last && owner == r->base;
    int n = r->cells[number].n, turn = 0, cut = 0;
    for (int line = region->first; line < region->end + (extra >= 0); line++) {
        const int k = line < region->end ? line : extra;
        const teg_line *const g = r->lines + k;
        teg_piece *const part = parts + turn;
        double d[TEG_PIECE];
        unsigned below;
        int rest;
        teg_on_corners(g->c, g->a, g->b, x, y, d);
        below = teg_below_level(d, 0.0);
        if (!below && !teg_on_line(d)) continue;
        if (teg_on_line(d) || below == all || r->used + TEG_PIECE > r->pool_room) {
            r->cell_count = cells, r->used = used;
            return !teg_on_line(d) && below == all;
        }
        part->n = teg_part(n, x, y, label, d, 1, 2 * k, part->x, part->y, part->label);
        rest = spare ? 1 : teg_part(n, x, y, label, d, -1, 2 * k + 1, r->x + r->used, r->y + r->used, r->label + r->used);
        if (!part->n || !rest) {
            r->cell_count = cells, r->used = used;
            return 0;
        }
        if (!spare) teg_new_cell(r, owner, k, rest);
        if (r->failed) return 1;
        cut = 1, n = part->n, x = part->x, y = part->y, label = part->label, turn = !turn;
    }
    r->cells[number].owner = region->region;
    if (!cut) return 1;
    teg_hang(r, number, cells);
    r->cells[number].n = n;
    memcpy(r->x + at, x, TEG_PIECE * sizeof *x);
    memcpy(r->y + at, y, TEG_PIECE * sizeof *y);
    memcpy(r->label + at, label, TEG_PIECE * sizeof *label);
    return 1;
}

//: teg_clip_cell
/* Give a region its part of a cell; what is cut off stays with the owner. `extra`: one more line, or -1. */
static void teg_clip_cell(teg_arrangement *r, size_t number, const teg_region *region, int extra)
{
    const teg_cell cell = r->cells[number];
    const size_t cells = r->cell_count, used = r->used;
    size_t at = cell.at;
    int n = cell.n, cut = 0;
    if (n <= TEG_PIECE && teg_clip_piece(r, number, region, extra)) return;
    for (int line = region->first; line < region->end + (extra >= 0); line++) {
        const int k = line < region->end ? line : extra;
        const teg_line *const g = r->lines + k;
        const double *x, *y;
        const int *label;
        int above = 0, below = 0, rest;
        double *swap;
        int *labels;
        if (!teg_room_in_scratch(r, (size_t)n + 2) || !teg_room_in_pool(r, (size_t)n + 2)) return;
        x = cut ? r->px : r->x + at, y = cut ? r->py : r->y + at, label = cut ? r->pl : r->label + at;
        for (int i = 0; i < n; i++) {
            const double d = g->c + g->a * x[i] + g->b * y[i];
            r->d[i] = fabs(d) < TEG_ON_LINE ? 0.0 : d;
            above += r->d[i] > 0.0, below += r->d[i] < 0.0;
        }
        if (!above || !below) {
            if (n - above - below > 1) teg_touch(r, region, n, x, y, label, 0.0);
            if (above) continue;
            r->cell_count = cells, r->used = used;
            return;
        }
        n = teg_split(n, x, y, label, r->d, k, r->qx, r->qy, r->ql, r->x + r->used, r->y + r->used, r->label + r->used, &rest);
        teg_close_piece(rest, r->x + r->used, r->y + r->used, r->label + r->used);
        teg_new_cell(r, cell.owner, k, rest);
        if (r->failed) return;
        swap = r->px, r->px = r->qx, r->qx = swap;
        swap = r->py, r->py = r->qy, r->qy = swap;
        labels = r->pl, r->pl = r->ql, r->ql = labels;
        cut = 1;
    }
    r->cells[number].owner = region->region;
    if (!cut) return;
    teg_hang(r, number, cells);
    if (n > cell.room) {
        if (!teg_room_in_pool(r, (size_t)n)) return;
        at = r->used;
        r->cells[number].at = at, r->cells[number].room = n;
        r->used += (size_t)n;
    }
    r->cells[number].n = n;
    for (int i = 0; i < n; i++) r->x[at + i] = r->px[i], r->y[at + i] = r->py[i], r->label[at + i] = r->pl[i];
    teg_close_piece(n, r->x + at, r->y + at, r->label + at);
}

//: teg_key_line
/* The line on which the keys of two candidates are equal, of the form g, which is positive where the second one is nearer. */
static int teg_key_line(teg_arrangement *r, int64_t owner, int64_t candidate, const double *g)
{
    const double size = sqrt(g[1] * g[1] + g[2] * g[2]);
    for (size_t k = r->line_count; k-- > 4 && r->lines[k].minus == candidate;)
        if (r->lines[k].plus == owner) return (int)k;
    return teg_add_line(r, g, size, owner, candidate, teg_forms(TEG_SHAPE(r->shape)) - 3);
}

//: teg_late_line
/* One more line on which the keys of two candidates are equal, for an edge that had another line. */
static int teg_late_line(teg_arrangement *r, int64_t owner, int64_t candidate, const double *g)
{
    const double size = sqrt(g[1] * g[1] + g[2] * g[2]);
    const int line = teg_add_line(r, g, size, owner, candidate, teg_forms(TEG_SHAPE(r->shape)) - 3);
    if (!r->failed) r->lines[line].late = 1;
    return line;
}

//: teg_key_difference
/* key - key; returns the larger of their sizes. */
static inline double teg_key_difference(const teg_arrangement *r, int64_t behind, int64_t before, double *g)
{
    double f[3], size;
    teg_key_form(r, behind, g);
    teg_key_form(r, before, f);
    size = teg_most_of(fabs(g[0]), fabs(f[0]));
    g[0] -= f[0], g[1] -= f[1], g[2] -= f[2];
    return size;
}

//: teg_key_tolerance
/* The value below which a difference of keys of this size counts as 0. */
static inline double teg_key_tolerance(const double *g, double size)
{
    return TEG_ON_LINE * sqrt(g[1] * g[1] + g[2] * g[2]) + TEG_KEY_ROUNDING * size;
}

//: teg_sides_at
/* On how many sides of the square a place lies. */
static inline int teg_sides_at(double x, double y)
{
    const int u = fabs(x) <= TEG_ON_LINE || fabs(1.0 - x) <= TEG_ON_LINE, v = fabs(y) <= TEG_ON_LINE || fabs(1.0 - y) <= TEG_ON_LINE;
    return u + v;
}

//: teg_note_concurrent
/* Note that a further key is equal to the owner's at corners of a cell, those where d is 0 to a tolerance; not along a side of the square. */
static void teg_note_concurrent(teg_arrangement *r, int64_t owner, size_t at, int n, double tolerance)
{
    const int parts = TEG_SHAPE(r->shape)->parts;
    for (int i = 0; i < n && r->concurrent < 2; i++) {
        const int before = (i ? i : n) - 1, after = i + 1 < n ? i + 1 : 0;
        const double x = r->x[at + i], y = r->y[at + i];
        int equal = 0;
        if (fabs(r->d[i]) > tolerance) continue;
        if (fabs(r->d[after]) <= tolerance && r->label[at + i] < 8) continue;
        if (fabs(r->d[before]) <= tolerance && r->label[at + before] < 8) continue;
        for (size_t k = 0; k < r->region_count + (r->base >= 0); k++) {
            const int64_t region = k < r->region_count ? r->regions[k].region : r->base;
            double g[3];
            const double size = teg_key_difference(r, owner / parts, region / parts, g);
            equal += fabs(g[0] + g[1] * x + g[2] * y) <= teg_key_tolerance(g, size);
        }
        r->concurrent = equal + teg_sides_at(x, y) > 4 ? 2 : 1;
    }
}

//: teg_insert_in_cell
/* Give a region its part of a cell. */
static void teg_insert_in_cell(teg_arrangement *r, const teg_region *region, size_t k)
{
    const int64_t owner = r->cells[k].owner;
    const size_t at = r->cells[k].at;
    const int n = r->cells[k].n, parts = TEG_SHAPE(r->shape)->parts;
    int extra = -1;
    if (owner >= 0) {
        double g[3], tolerance;
        int above = 0, below = 0, equal = 0;
        if (owner / parts == region->region / parts) return;
        if (!teg_room_in_scratch(r, (size_t)n + 2)) return;
        tolerance = teg_key_difference(r, owner / parts, region->region / parts, g);
        tolerance = teg_key_tolerance(g, tolerance);
        if (n <= TEG_PIECE) {
            teg_on_corners(g[0], g[1], g[2], r->x + at, r->y + at, r->d);
            above = teg_above_level(r->d, tolerance) != 0, below = teg_below_level(r->d, -tolerance) != 0;
            equal = (teg_above_level(r->d, tolerance) | teg_below_level(r->d, -tolerance)) != (1u << TEG_PIECE) - 1;
        } else
            for (int i = 0; i < n; i++) {
                const double d = r->d[i] = g[0] + g[1] * r->x[at + i] + g[2] * r->y[at + i];
                above |= d > tolerance, below |= d < -tolerance, equal |= fabs(d) <= tolerance;
            }
        if (TEG_SHAPE(r->shape)->order && !r->guarded && equal && (above || below)) teg_note_concurrent(r, owner, at, n, tolerance);
        if (above != below && equal) teg_touch(r, region, n, r->x + at, r->y + at, r->label + at, tolerance);
        if (!above && (below || region->region > owner)) return;
        if (above && below) extra = teg_key_line(r, owner / parts, region->region / parts, g);
    }
    teg_clip_cell(r, k, region, extra);
}

//: teg_bound
/* Find the corners of a polygon around a region, TEG_BESIDE from it or more: of the tile and the guards, all moved outwards. */
static void teg_bound(teg_arrangement *r, const teg_region *region)
{
    const double u0 = r->u[0] - TEG_BESIDE, u1 = r->u[1] + TEG_BESIDE, v0 = r->v[0] - TEG_BESIDE, v1 = r->v[1] + TEG_BESIDE;
    const double x[4] = {u0, u1, u1, u0}, y[4] = {v0, v0, v1, v1};
    int n = 4;
    if (!teg_room_in_scratch(r, 6)) return;
    memcpy(r->px, x, sizeof x);
    memcpy(r->py, y, sizeof y);
    memset(r->pl, 0, 4 * sizeof(int));
    for (int k = region->first; k < region->end && n; k++) {
        const teg_line g = r->lines[k];
        double *swap;
        if (!teg_room_in_scratch(r, (size_t)n + 2)) return;
        for (int i = 0; i < n; i++) r->d[i] = g.c + TEG_BESIDE + g.a * r->px[i] + g.b * r->py[i];
        n = teg_half(n, r->px, r->py, r->pl, r->d, 1.0, 0, r->qx, r->qy, r->ql);
        swap = r->px, r->px = r->qx, r->qx = swap;
        swap = r->py, r->py = r->qy, r->qy = swap;
        memset(r->pl, 0, (size_t)n * sizeof(int));
    }
    if ((size_t)n > r->bound_room) {
        r->bound_room = 2 * (size_t)n;
        r->bound = teg_grown(r->bound, 1, 0, 2 * r->bound_room * sizeof(double), &r->failed);
        if (r->failed) return;
    }
    for (int i = 0; i < n; i++) r->bound[2 * i] = r->px[i], r->bound[2 * i + 1] = r->py[i];
    r->bounds = n;
}

//: teg_insert_by_cuts
/* One more region among many cells. A cut that the polygon around it does not meet has one side on which the region is; cells on the other
   side, whose corners are at most TEG_ON_LINE beyond the line, are away from it. */
static void teg_insert_by_cuts(teg_arrangement *r, const teg_region *region)
{
    size_t waiting = 1;
    teg_bound(r, region);
    if (r->cell_count > r->pending_room) {
        r->pending_room = 2 * r->cell_count;
        r->pending = teg_grown(r->pending, 1, 0, r->pending_room * sizeof(int), &r->failed);
    }
    if (r->failed || !r->bounds) return;
    r->pending[0] = r->cells[0].sides[0];
    while (waiting && !r->failed) {
        const int cut = r->pending[--waiting];
        int above = 0, below = 0;
        if (cut < 0) {
            teg_insert_in_cell(r, region, (size_t)~cut);
            continue;
        }
        const teg_line g = r->lines[r->cells[cut].line];
        for (int i = 0; i < r->bounds; i++) {
            const double d = g.c + g.a * r->bound[2 * i] + g.b * r->bound[2 * i + 1];
            above |= d >= 0.0, below |= d <= 0.0;
        }
        if (below) r->pending[waiting++] = r->cells[cut].sides[1];
        if (above) r->pending[waiting++] = r->cells[cut].sides[0];
    }
}

//: teg_insert
/* One more region. */
static void teg_insert(teg_arrangement *r, const teg_region *region)
{
    const size_t cells = r->cell_count;
    if (cells >= TEG_MANY_CELLS) teg_insert_by_cuts(r, region);
    else
        for (size_t k = 0; k < cells && !r->failed; k++) teg_insert_in_cell(r, region, k);
}

//: teg_present
/* Whether a region may be in the tile; if so its guards with cutting lines are noted. */
static inline int teg_present(teg_arrangement *r, teg_region *region)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const double *const f = r->rows + region->region / s->parts * teg_row(s) + 3 * (int)(region->region % s->parts) * s->guards;
    const teg_signs signs = teg_signs_of(f, s->guards, r->u, r->v, r->su, r->sv);
    region->cuts = signs.cuts;
    r->undefined |= !signs.absent & (signs.infinite != 0);
    return !signs.absent;
}

//: teg_draw
/* Add the cutting lines of a region. */
static void teg_draw(teg_arrangement *r, teg_region *region)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int64_t candidate = region->region / s->parts;
    region->first = (int)r->line_count, region->end = region->first;
    for (unsigned cuts = region->cuts; cuts; cuts &= cuts - 1) region->end++;
    for (unsigned cuts = region->cuts; cuts; cuts &= cuts - 1) {
        const int column = 3 * ((int)(region->region % s->parts) * s->guards + teg_lowest_bit(cuts));
        double g[3];
        int line;
        teg_form(r, candidate, column, g);
        line = teg_add_line(r, g, sqrt(g[1] * g[1] + g[2] * g[2]), candidate, -1, column);
        if (r->failed) return;
        r->lines[line].first = region->first, r->lines[line].end = region->end;
    }
}

//: teg_by_middle
static int teg_by_middle(const void *a, const void *b)
{
    const teg_region *const p = a, *const q = b;
    return p->middle < q->middle ? -1 : p->middle > q->middle ? 1 : p->region < q->region ? -1 : p->region > q->region;
}

//: teg_sort_regions
/* Put regions in their order: few of them by insertion. */
static void teg_sort_regions(teg_region *regions, size_t count)
{
    if (count > TEG_FEW) qsort(regions, count, sizeof *regions, teg_by_middle);
    else
        for (size_t k = 1; k < count; k++) {
            const teg_region region = regions[k];
            size_t at = k;
            for (; at && teg_by_middle(regions + at - 1, &region) > 0; at--) regions[at] = regions[at - 1];
            regions[at] = region;
        }
}

//: teg_select
/* Find the regions that may be seen in the tile, in their order, among those of a list (NULL: all); and the base, which covers it. */
static void teg_select(teg_arrangement *r, const int64_t *list, int64_t regions)
{
    static const teg_line sides[4] = {{0, 1, 0, 1, -1, -1, 0, 0, 0, -1, 0}, {1, -1, 0, 1, -1, -1, 0, 0, 0, -1, 0},
        {0, 0, 1, 1, -1, -1, 0, 0, 0, -1, 0}, {1, 0, -1, 1, -1, -1, 0, 0, 0, -1, 0}};
    const teg_shape *const s = TEG_SHAPE(r->shape);
    int64_t base = -1;
    double nearest = INFINITY;
    size_t kept = 0;
    r->undefined = r->alone = 0;
    r->cell_count = r->region_count = r->used = 0;
    memcpy(r->lines, sides, sizeof sides);
    r->line_count = 4;
    for (int64_t k = 0; k < regions && !r->undefined && !r->failed; k++) {
        teg_region *region;
        double g[3], highest;
        int present, better;
        if (r->region_count == r->region_room) {
            r->regions =
                teg_grown(r->regions, r->own_regions, r->region_count * sizeof *region, 2 * r->region_room * sizeof *region, &r->failed);
            if (r->failed) return;
            r->own_regions = 1;
            r->region_room *= 2;
        }
        region = r->regions + r->region_count;
        region->region = list ? list[k] : k;
        present = teg_present(r, region);
        teg_key_form(r, region->region / s->parts, g);
        r->undefined |= present & !((fabs(g[0]) < INFINITY) & (fabs(g[1]) < INFINITY) & (fabs(g[2]) < INFINITY));
        region->middle = g[0] + 0.5 * (r->u[0] + r->u[1]) * g[1] + 0.5 * (r->v[0] + r->v[1]) * g[2];
        highest = teg_highest(r, g);
        better = present & !region->cuts & ((base < 0) | (highest < nearest));
        base = better ? region->region : base, nearest = better ? highest : nearest;
        r->region_count += (size_t)present;
    }
    r->base = base;
    for (size_t k = 0; k < r->region_count && base >= 0 && !r->undefined; k++) {
        const teg_region *const region = r->regions + k;
        teg_region *const to = r->regions + kept;
        double g[3];
        const double size = teg_key_difference(r, region->region / s->parts, base / s->parts, g), lowest = teg_lowest(r, g);
        const int hidden = (region->region == base) | (lowest > TEG_ON_LINE * (fabs(g[1]) + fabs(g[2])) + TEG_KEY_ROUNDING * size);
        to->middle = region->middle, to->region = region->region, to->cuts = region->cuts;
        kept += (size_t)!hidden;
    }
    if (base >= 0) r->region_count = kept;
    for (size_t k = 0; k < r->region_count && !r->undefined && !r->failed; k++) teg_draw(r, r->regions + k);
}

//: teg_held
/* The part of an edge where the guards of a region hold; returns whether one of them has the line of the edge. */
static int teg_held(const teg_arrangement *r, const teg_region *region, const double *edge, double *part)
{
    int coincides = 0;
    part[0] = 0.0, part[1] = 1.0;
    for (int k = region->first; k < region->end; k++) {
        const teg_line *const g = r->lines + k;
        const double d = g->c + g->a * edge[0] + g->b * edge[1], e = d + g->a * edge[2] + g->b * edge[3];
        if (fabs(d) < TEG_ON_LINE && fabs(e) < TEG_ON_LINE) coincides = 1;
        else if (d < TEG_ON_LINE && e < TEG_ON_LINE) part[1] = -1.0;
        else if (d < 0.0) part[0] = fmax(part[0], d / (d - e));
        else if (e < 0.0) part[1] = fmin(part[1], d / (d - e));
    }
    return coincides;
}

//: teg_beyond
/* The region beyond an edge (x, y, dx, dy) whose key is equal to the owner's along it, or -1: of those whose keys are equal there the one with
   the least key beyond. `partner` (or -1), which made the edge with the owner, may be there in several parts. Straight lines over an
   interval, whose keys have no v, may be three in one point: the pair that is there counts. */
static int64_t teg_beyond(teg_arrangement *r, int64_t owner, int64_t partner, const double *edge)
{
    const int parts = TEG_SHAPE(r->shape)->parts;
    const double length = sqrt(edge[2] * edge[2] + edge[3] * edge[3]);
    const teg_region base = {0.0, r->base, 0, 0, 0};
    double steepest = 0.0, own[3];
    int64_t nearest = -1;
    if (length <= TEG_ON_LINE) return -1;
    teg_key_form(r, owner / parts, own);
    for (size_t k = 0; k < r->region_count + (r->base >= 0); k++) {
        const teg_region *const region = k < r->region_count ? r->regions + k : &base;
        double part[2], g[3], d, e, slope, flat, tolerance;
        const int coincides = teg_held(r, region, edge, part);
        if (coincides || (part[1] - part[0]) * length <= TEG_ON_LINE) continue;
        tolerance = teg_key_difference(r, owner / parts, region->region / parts, g);
        tolerance = teg_key_tolerance(g, tolerance);
        d = g[0] + g[1] * edge[0] + g[2] * edge[1], e = d + g[1] * edge[2] + g[2] * edge[3];
        slope = (g[1] * edge[3] - g[2] * edge[2]) / length; /* corners go round anticlockwise */
        flat = 0.0;
        for (int i = 0; i < 3; i++) flat += fabs(own[i]) + fabs(own[i] - g[i]);
        flat *= TEG_KEY_ROUNDING;
        if (fmax(fabs(d), fabs(e)) > tolerance || slope <= flat) continue;
        r->ambiguous |= region->region / parts != partner && (part[1] - part[0]) * length < length - TEG_ON_LINE;
        r->ambiguous |= nearest >= 0 && fabs(slope - steepest) > flat && (own[2] != 0.0 || g[2] != 0.0);
        if (nearest < 0 || slope > steepest + flat || (slope >= steepest - flat && region->region < nearest))
            steepest = slope, nearest = region->region;
    }
    return nearest;
}

//: teg_assign_key_edges
/* Give edges on which two keys are equal the lines of the owners of both sides. A cut keeps the line of the pair that made it, although other
   candidates may own its sides later whose keys are equal on the same line, as in regular grids of sites. */
static void teg_assign_key_edges(teg_arrangement *r)
{
    const int parts = TEG_SHAPE(r->shape)->parts;
    for (size_t k = 0; k < r->cell_count && !r->failed; k++) {
        const teg_cell cell = r->cells[k];
        for (int i = 0; i < cell.n && cell.owner >= 0 && !r->failed; i++) {
            const int label = r->label[cell.at + i], j = i + 1 == cell.n ? 0 : i + 1;
            const double x = r->x[cell.at + i], y = r->y[cell.at + i];
            const double edge[4] = {x, y, r->x[cell.at + j] - x, r->y[cell.at + j] - y};
            const teg_line line = r->lines[label >> 1];
            const int64_t owner = cell.owner / parts;
            const int64_t partner = line.plus == owner ? line.minus : line.minus == owner ? line.plus : -1;
            int64_t beyond;
            double g[3];
            if (label < 8 || line.minus < 0) continue;
            beyond = teg_beyond(r, cell.owner, partner, edge);
            if (beyond < 0 || beyond / parts == partner) continue;
            beyond /= parts;
            teg_key_difference(r, owner, beyond, g);
            r->label[cell.at + i] = 2 * teg_late_line(r, owner, beyond, g) + 1;
        }
    }
}

//: teg_arrange
/* Cut the tile into cells. Those of the base may be left out if its polynomials are known (see `teg_values`). */
static void teg_arrange(teg_arrangement *r, int known)
{
    const double x[4] = {r->u[0], r->u[1], r->u[1], r->u[0]}, y[4] = {r->v[0], r->v[0], r->v[1], r->v[1]};
    static const int label[4] = {4, 2, 6, 0};
    for (int i = 0; i < 4; i++) r->x[i] = x[i], r->y[i] = y[i], r->label[i] = label[i];
    teg_close_piece(4, r->x, r->y, r->label);
    teg_new_cell(r, r->base, 0, 4);
    r->cells[0].sides[0] = ~0, r->cells[0].up = 0;
    r->tied = 0;
    teg_sort_regions(r->regions, r->region_count);
    for (size_t k = 0; k < r->region_count && !r->failed; k++) {
        r->last = known && k + 1 == r->region_count;
        teg_insert(r, r->regions + k);
    }
    if (r->tied && !r->failed) teg_assign_key_edges(r);
}

//: teg_by_angle
static int teg_by_angle(const void *a, const void *b)
{
    const teg_twin *const p = a, *const q = b;
    if (p->angle != q->angle) return p->angle < q->angle ? -1 : 1;
    return p->c < q->c ? -1 : p->c > q->c ? 1 : p->rank < q->rank ? -1 : p->rank > q->rank;
}

//: teg_sort_twins
/* Put lines in their order: few of them by insertion. */
static void teg_sort_twins(teg_twin *twins, size_t count)
{
    if (count > TEG_FEW) qsort(twins, count, sizeof *twins, teg_by_angle);
    else
        for (size_t k = 1; k < count; k++) {
            const teg_twin twin = twins[k];
            size_t at = k;
            for (; at && teg_by_angle(twins + at - 1, &twin) > 0; at--) twins[at] = twins[at - 1];
            twins[at] = twin;
        }
}

//: teg_may_have_twins
/* Whether lines of two regions may be one: there are few, and none of them has another one's direction and distance, to more than what
   counts as the same. */
static int teg_may_have_twins(const teg_arrangement *r)
{
    const size_t count = r->line_count;
    int found = count > TEG_FEW;
    for (size_t k = 0; k + 1 < r->region_count && !found; k++)
        for (int i = r->regions[k].first; i < r->regions[k].end; i++)
            for (size_t m = k + 1; m < r->region_count; m++)
                for (int j = r->regions[m].first; j < r->regions[m].end; j++) {
                    const teg_line *const g = r->lines + i, *const h = r->lines + j;
                    const double across = g->a * h->b - g->b * h->a, along = g->a * h->a + g->b * h->b;
                    found |= (fabs(across) < 8.0 / TEG_ANGLES) & (fabs(along < 0.0 ? g->c + h->c : g->c - h->c) < 2.0 * TEG_SAME);
                }
    return found;
}

//: teg_find_twins
/* Find guards of different regions whose lines are one: a line's `twin` is where it is among them, or -1 if it is alone. */
static void teg_find_twins(teg_arrangement *r)
{
    size_t count = 0;
    int alike = 0;
    double last;
    r->twin_count = 0;
    if (r->region_count < 2 || r->alone || !teg_may_have_twins(r)) return;
    if (r->line_count > r->twin_room) {
        r->twins = teg_grown(r->twins, 1, 0, 2 * r->line_count * sizeof *r->twins, &r->failed);
        if (r->failed) return;
        r->twin_room = 2 * r->line_count;
    }
    for (size_t k = 0; k < r->region_count; k++)
        for (int line = r->regions[k].first; line < r->regions[k].end; line++) {
            const teg_line g = r->lines[line];
            const double sign = (fabs(g.a) > TEG_SAME ? g.a : g.b) < 0.0 ? -1.0 : 1.0;
            const teg_twin twin = {floor(sign * g.b / (1.0 + sign * g.a) * TEG_ANGLES + 0.5), sign * g.c, sign, (int)k, line};
            r->twins[count++] = twin;
        }
    r->twin_count = count;
    teg_sort_twins(r->twins, count);
    last = count ? r->twins[0].c : 0.0;
    for (size_t k = 1, first = 0; k < count; k++) { /* one distance for all of a line */
        const int same = r->twins[k].angle == r->twins[k - 1].angle && r->twins[k].c - last < TEG_SAME;
        last = r->twins[k].c;
        if (same) r->twins[k].c = r->twins[first].c, alike = 1;
        else first = k;
    }
    if (alike) teg_sort_twins(r->twins, count);
    for (size_t k = 1; alike && k < count; k++) {
        if (r->twins[k].angle != r->twins[k - 1].angle || r->twins[k].c != r->twins[k - 1].c) continue;
        r->lines[r->twins[k - 1].line].twin = (int)k - 1, r->lines[r->twins[k].line].twin = (int)k;
    }
}

//: teg_edge_of
/* The part of a straight line where the guards of a line's region hold, but for this one. */
static void teg_edge_of(const teg_arrangement *r, int line, double x, double y, double dx, double dy, double *part)
{
    part[0] = 0.0, part[1] = 1.0;
    for (int k = r->lines[line].first; k < r->lines[line].end; k++) {
        const teg_line *const g = r->lines + k;
        const double d = g->c + g->a * x + g->b * y, e = g->c + g->a * (x + dx) + g->b * (y + dy);
        if (k == line) continue;
        if (d < 0.0 && e < 0.0) part[0] = 1.0, part[1] = 0.0;
        else if (d < 0.0) part[0] = fmax(part[0], d / (d - e));
        else if (e < 0.0) part[1] = fmin(part[1], d / (d - e));
    }
}

//: teg_is_shared
/* Whether the edge of a twin lies on an edge that goes on beyond that of its own region. */
static int teg_is_shared(const teg_arrangement *r, int line, const double *edge)
{
    const int at = r->lines[line].twin;
    const teg_twin *const t = r->twins;
    const double length = sqrt(edge[2] * edge[2] + edge[3] * edge[3]);
    double own[2], range[2];
    if (at < 0) return 0;
    teg_edge_of(r, line, edge[0], edge[1], edge[2], edge[3], own);
    for (int step = -1; step <= 1; step += 2)
        for (int k = at + step; k >= 0 && k < (int)r->twin_count; k += step) {
            if (t[k].angle != t[k - step].angle || fabs(t[k].c - t[k - step].c) >= TEG_SAME) break;
            if (r->lines[t[k].line].first == r->lines[line].first) continue; /* of the same region, which is thin */
            teg_edge_of(r, t[k].line, edge[0], edge[1], edge[2], edge[3], range);
            if ((range[1] - range[0] - fmax(0.0, fmin(own[1], range[1]) - fmax(own[0], range[0]))) * length > TEG_ON_LINE) return 1;
        }
    return 0;
}

//: teg_next_share
/* The next part of an edge and the line that it belongs to, and that line's sign; 0 where there is no more. A cut goes on beyond the region
   that made it: where the edge of another region lies on it, what is there is that one's. `part` holds the part; -1, -1 at first. */
static int teg_next_share(const teg_arrangement *r, int line, const double *edge, double *part, int *share, double *sign)
{
    const int at = part[1] > 0.0 || teg_is_shared(r, line, edge) ? r->lines[line].twin : -1;
    int low = at, high = at;
    double begin = part[1] < 0.0 ? 0.0 : part[1], end = 1.0;
    if (begin >= 1.0 - TEG_ON_LINE) return 0;
    *share = line, *sign = 1.0;
    if (at >= 0) {
        const teg_twin *const t = r->twins;
        const double own = t[at].sign;
        while (low > 0 && t[low - 1].angle == t[low].angle && t[low].c - t[low - 1].c < TEG_SAME) low--;
        while (high + 1 < (int)r->twin_count && t[high + 1].angle == t[high].angle && t[high + 1].c - t[high].c < TEG_SAME) high++;
        for (int k = low - 1, found = 0; k <= high && !found; k++) {
            const int other = k < low ? line : t[k].line;
            double range[2];
            if (k >= low && r->lines[t[k].line].first == r->lines[line].first) continue;
            teg_edge_of(r, other, edge[0], edge[1], edge[2], edge[3], range);
            if (range[0] <= begin + TEG_ON_LINE && range[1] > begin + TEG_ON_LINE)
                *share = other, *sign = k < low ? 1.0 : own * t[k].sign, end = fmin(end, range[1]), found = 1;
            else if (range[0] > begin && range[1] - range[0] > TEG_ON_LINE)
                end = fmin(end, range[0]); /* where one that comes before begins */
        }
    }
    part[0] = begin, part[1] = end > 1.0 - TEG_ON_LINE ? 1.0 : end;
    return 1;
}
