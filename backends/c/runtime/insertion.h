/* One more candidate among the cells of the square: each gives it the part that it is nearer in, or keeps all of it. */

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
    teg_copy_corners(x, y, label, r->x + at, r->y + at, r->label + at);
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
        if (TEG_SHAPE(r->shape)->order && above + below < n)
            for (int i = 0; i < n; i++)
                if (r->d[i] == 0.0) teg_note_place(r, x[i], y[i]);
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
    if (owner >= 0 && !(region->front && owner == r->base)) {
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
        if (TEG_SHAPE(r->shape)->order && r->guarded && equal)
            for (int i = 0; i < n; i++)
                if (fabs(r->d[i]) <= tolerance) teg_note_place(r, r->x[at + i], r->y[at + i]);
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
