/* Which candidates may be seen in a tile, in their order, and the cells of a tile; edges that other pairs of candidates have. */

//: teg_draw
/* Add the cutting lines of a region. */
static void teg_draw(teg_arrangement *r, teg_region *region)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int64_t candidate = region->region / s->parts;
    region->first = (int)r->line_count;
    for (unsigned cuts = region->cuts; cuts; cuts &= cuts - 1) {
        const int column = 3 * ((int)(region->region % s->parts) * s->guards + teg_lowest_bit(cuts));
        double g[3];
        int line;
        teg_form(r, candidate, column, g);
        line = teg_add_line(r, g, sqrt(g[1] * g[1] + g[2] * g[2]), candidate, -1, column);
        if (r->failed) return;
        r->lines[line].first = region->first;
    }
    region->end = (int)r->line_count;
    for (int line = region->first; line < region->end; line++) r->lines[line].end = region->end;
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

//: teg_room_for_region
/* Make room for one more region behind so many. */
static inline int teg_room_for_region(teg_arrangement *r, size_t count)
{
    if (count < r->region_room) return 1;
    r->regions = teg_grown(r->regions, r->own_regions, count * sizeof *r->regions, 2 * count * sizeof *r->regions, &r->failed);
    if (r->failed) return 0;
    r->own_regions = 1, r->region_room = 2 * count;
    return 1;
}

//: teg_find_present
/* Find the regions of a list (NULL: all) that may be in the tile, which is the unit square, not moved, if `whole` is not 0; and the base, which
   covers it with the least highest key. Nothing here is a branch, nor does a region wait for the one before it. */
TEG_INLINE void teg_find_present(teg_arrangement *r, const int64_t *list, int64_t regions, int whole)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    const int64_t width = teg_row(s);
    const double u[2] = {r->u[0], r->u[1]}, v[2] = {r->v[0], r->v[1]}, *const rows = r->rows;
    int64_t base = -1;
    double nearest = INFINITY;
    size_t count = 0;
    int undefined = 0;
    for (int64_t k = 0; k < regions; k++) {
        const int64_t number = list ? list[k] : k, candidate = number / s->parts;
        const double *const row = rows + candidate * width, *const key = row + teg_forms(s) - 3;
        const double *const guards = row + 3 * (int)(number % s->parts) * s->guards;
        const teg_signs signs = teg_signs_of_all(guards, s->guards, u, v, r->su, r->sv, whole);
        double g[3] = {key[0], key[1], key[2]}, highest, middle;
        int present = !signs.absent, better;
        teg_region *region;
        if (!teg_room_for_region(r, count)) return;
        if (whole) middle = g[0] + 0.5 * g[1] + 0.5 * g[2], highest = g[0] + teg_most_of(g[1], 0.0) + teg_most_of(g[2], 0.0);
        else {
            teg_key_form(r, candidate, g);
            middle = g[0] + 0.5 * (u[0] + u[1]) * g[1] + 0.5 * (v[0] + v[1]) * g[2], highest = teg_highest(r, g);
        }
        undefined |= present & ((signs.infinite != 0) | !((fabs(g[0]) < INFINITY) & (fabs(g[1]) < INFINITY) & (fabs(g[2]) < INFINITY)));
        highest = teg_pick(present & !signs.cuts, highest, INFINITY);
        better = highest < nearest;
        base += -(int64_t)better & (number - base), nearest = teg_least_of(highest, nearest);
        region = r->regions + count;
        region->middle = middle, region->region = number, region->cuts = signs.cuts, region->front = 1;
        count += (size_t)present;
    }
    r->region_count = count, r->undefined = undefined, r->base = base;
}

//: teg_leave_out_hidden
/* Leave out the regions that are behind the base on all of the tile, and the base; note which are in front of it. */
TEG_INLINE void teg_leave_out_hidden(teg_arrangement *r, int whole)
{
    const int64_t base = r->base, parts = TEG_SHAPE(r->shape)->parts;
    size_t kept = 0;
    for (size_t k = 0; k < r->region_count; k++) {
        const teg_region *const region = r->regions + k;
        teg_region *const to = r->regions + kept;
        double g[3];
        const double size = teg_key_difference(r, region->region / parts, base / parts, g);
        const double lowest = whole ? g[0] + teg_least_of(g[1], 0.0) + teg_least_of(g[2], 0.0) : teg_lowest(r, g);
        const double highest = whole ? g[0] + teg_most_of(g[1], 0.0) + teg_most_of(g[2], 0.0) : teg_highest(r, g);
        const double tolerance = TEG_ON_LINE * (fabs(g[1]) + fabs(g[2])) + TEG_KEY_ROUNDING * size;
        const int hidden = (region->region == base) | (lowest > tolerance);
        to->middle = region->middle, to->region = region->region, to->cuts = region->cuts, to->front = highest < -2.0 * tolerance;
        kept += (size_t)!hidden;
    }
    r->region_count = kept;
}

//: teg_select_on
/* `teg_select`; `whole`: whether the tile is the unit square, not moved, and keys are not taken apart. */
TEG_INLINE void teg_select_on(teg_arrangement *r, const int64_t *list, int64_t regions, int whole)
{
    r->alone = 0;
    r->cell_count = r->region_count = r->used = 0;
    r->line_count = 4;
    teg_find_present(r, list, regions, whole);
    if (r->undefined || r->failed) return;
    if (r->base >= 0) teg_leave_out_hidden(r, whole);
    for (size_t k = 0; k < r->region_count && !r->failed; k++) teg_draw(r, r->regions + k);
}

//: teg_select
/* Find the regions that may be seen in the tile among those of a list (NULL: all), and their lines; and the base, which covers it. */
static void teg_select(teg_arrangement *r, const int64_t *list, int64_t regions)
{
    teg_select_on(r, list, regions, 0);
}

//: teg_select_on_square
/* The same of all regions on the unit square. */
static void teg_select_on_square(teg_arrangement *r, int64_t regions)
{
    teg_select_on(r, NULL, regions, 1);
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
    const teg_region base = {0.0, r->base, 0, 0, 0, 0};
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
    static const teg_line sides[4] = {{0, 1, 0, 1, -1, -1, 0, 0, 0, -1, 0}, {1, -1, 0, 1, -1, -1, 0, 0, 0, -1, 0},
        {0, 0, 1, 1, -1, -1, 0, 0, 0, -1, 0}, {1, 0, -1, 1, -1, -1, 0, 0, 0, -1, 0}};
    memcpy(r->lines, sides, sizeof sides);
    teg_copy_corners(teg_square.x, teg_square.y, teg_square.label, r->x, r->y, r->label);
    if (r->u[0] != 0.0 || r->v[0] != 0.0 || r->u[1] != 1.0 || r->v[1] != 1.0)
        for (int i = 0; i < TEG_PIECE; i++) r->x[i] = r->u[r->x[i] > 0.0], r->y[i] = r->v[r->y[i] > 0.0];
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
