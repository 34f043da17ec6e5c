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
   first and one behind the last; `front`: whether it is nearer than the base on all of the tile, with a margin, or there is no base. */
typedef struct {
    double middle;
    int64_t region;
    int first, end;
    unsigned cuts;
    int front;
} teg_region;

//: teg_arrangement
/* The cells of a tile of the square, from (u[0], v[0]) to (u[1], v[1]), moved by (su, sv), and all that they are made of. Arrays begin on the
   stack, and move to the heap as they grow. `nudge`: how far keys are taken apart; `guarded`: guards have lines in the square; `tied`: something
   else has the line of an edge on which two keys are equal; `ambiguous`: such an edge has no derivative; `concurrent`: more keys are equal at
   one place than have a second derivative there, 2 if it has no two sides; `alone`: it is known that no two regions have one line; `last`:
   the last region is being inserted, and cells of the base need not be there; `place`: corners that
   lie on a line which is no edge of their cell, as many as there is room for; `parting`: the largest speed with which lines leave such a place
   along the direction; `moving`: the largest with which anything moves. */
typedef struct {
    const teg_shape *shape;
    const double *rows;
    int64_t n;
    double su, sv, nudge, parting, moving, u[2], v[2], place[2 * TEG_PLACES];
    int touching, concurrent, guarded, undefined, failed, tied, ambiguous, alone, last, places;
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

//: teg_note_place
/* Note a corner on a line, if it is not noted yet. */
static void teg_note_place(teg_arrangement *r, double x, double y)
{
    for (int k = 0; k < r->places; k++)
        if (fabs(r->place[2 * k] - x) <= TEG_ON_LINE && fabs(r->place[2 * k + 1] - y) <= TEG_ON_LINE) return;
    if (r->places < TEG_PLACES) r->place[2 * r->places] = x, r->place[2 * r->places + 1] = y, r->places++;
}

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
    teg_copy_corners(piece->x, piece->y, piece->label, r->x + r->used, r->y + r->used, r->label + r->used);
    teg_new_cell(r, owner, 0, piece->n);
}

//: teg_form
/* A form of a candidate in the coordinates of the square. */
static inline void teg_form(const teg_arrangement *r, int64_t candidate, int column, double *g)
{
    const double *const f = r->rows + candidate * teg_row(TEG_SHAPE(r->shape)) + column;
    g[0] = f[0], g[1] = f[1], g[2] = f[2];
    if (r->su != 0.0) g[0] = f[0] + f[1] * r->su + f[2] * r->sv; /* most squares are not moved: nothing waits for products by 0 */
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
