/* Cells with signs: where few candidates are in a square, and no three of them lie over one another, the part of a candidate that is seen is
   its part of the square without what others hide, and integrals over it are differences. Nothing is cut that is no border. */

//: teg_trim
enum { TEG_WHOLE, TEG_PART, TEG_NOTHING, TEG_UNCLEAR };

/* What is left of a piece where c + a u + b v >= 0, its new edge with this label; TEG_UNCLEAR (and any piece) where a corner lies on the
   line. */
static inline int teg_trim(teg_piece *piece, double c, double a, double b, int label)
{
    double d[TEG_PIECE];
    unsigned below;
    int n;
    teg_on_corners(c, a, b, piece->x, piece->y, d);
    below = teg_below_level(d, 0.0);
    if (teg_on_line(d)) return TEG_UNCLEAR;
    if (!below) return TEG_WHOLE;
    if (below == (1u << TEG_PIECE) - 1) return TEG_NOTHING;
    n = teg_part(piece->n, piece->x, piece->y, piece->label, d, 1, label, piece->x, piece->y, piece->label);
    if (n) piece->n = n;
    return n ? TEG_PART : TEG_UNCLEAR;
}

//: teg_pieces
/* The parts of the square of all regions (n is 0: none, or hidden), the lines on which their keys are the base's (or -1), and which of them
   lie over one another, as bits; which have lines that others have too (`lent`), and which are hidden in part; `label`: of lines; `same`:
   which lines of other regions are one with a line, as bits. */
typedef struct {
    teg_piece of[TEG_PIECES];
    int key[TEG_PIECES];
    unsigned over[TEG_PIECES], lent, hidden;
    int label[TEG_PIECE_LINES];
    uint64_t same[TEG_PIECE_LINES];
} teg_pieces;

//: teg_find_same
/* Find the lines of different regions that are one, to more than what counts as the same. Their distances are compared side by
   side; few are as far away as another one. */
static void teg_find_same(const teg_arrangement *r, teg_pieces *all)
{
    const int count = (int)r->line_count;
    double away[TEG_PIECE_LINES + TEG_PIECE], d[TEG_PIECE];
    for (int k = 0; k < count; k++) away[k] = fabs(r->lines[k].c), all->same[k] = 0;
    for (int k = count; k < count + TEG_PIECE; k++) away[k] = INFINITY;
    for (int i = 4; i < count; i++) {
        const teg_line *const g = r->lines + i;
        for (int first = g->end; first < count; first += TEG_PIECE) {
            for (int k = 0; k < TEG_PIECE; k++) d[k] = fabs(away[i] - away[first + k]);
            for (unsigned near = teg_below_level(d, 2.0 * TEG_SAME); near; near &= near - 1) {
                const int j = first + teg_lowest_bit(near);
                const teg_line *const h = r->lines + j;
                const double across = g->a * h->b - g->b * h->a, along = g->a * h->a + g->b * h->b;
                const double apart = fabs(along < 0.0 ? g->c + h->c : g->c - h->c);
                const int same = (fabs(across) < 8.0 / TEG_ANGLES) & (apart < 2.0 * TEG_SAME);
                all->same[i] |= (uint64_t)same << j, all->same[j] |= (uint64_t)same << i;
            }
        }
    }
}

//: teg_cut_by_line
/* What is left of a piece where the form of a line is >= 0. */
static inline int teg_cut_by_line(const teg_arrangement *r, int line, int label, teg_piece *piece)
{
    return teg_trim(piece, r->lines[line].c, r->lines[line].a, r->lines[line].b, label);
}

//: teg_cut_by_region
/* What is left of a piece on a region. */
static int teg_cut_by_region(const teg_arrangement *r, const teg_region *region, const int *label, teg_piece *piece)
{
    int state = TEG_WHOLE;
    for (int k = region->first; k < region->end && state <= TEG_PART; k++) {
        const int cut = teg_cut_by_line(r, k, label[k], piece);
        state = cut > state ? cut : state;
    }
    return state;
}

//: teg_which_side
/* Whether a difference of keys is above 0 at all corners of a piece (1), below 0 (-1), both (0), or it is not clear (2). */
static int teg_which_side(const teg_piece *piece, const double *g, double tolerance)
{
    const unsigned all = (1u << TEG_PIECE) - 1;
    double d[TEG_PIECE];
    unsigned above, below;
    teg_on_corners(g[0], g[1], g[2], piece->x, piece->y, d);
    above = teg_above_level(d, tolerance), below = teg_below_level(d, -tolerance);
    if (above == all) return 1;
    if (below == all) return -1;
    return above && below ? 0 : 2;
}

//: teg_cut_pieces
/* Make the parts of the square of all regions. They are cut in turn, since each cut waits for the one before. Returns 0 where it is not
   clear. */
static int teg_cut_pieces(const teg_arrangement *r, teg_pieces *all)
{
    const int count = (int)r->region_count;
    int more = 1;
    for (int k = 0; k < count; k++) teg_copy_piece(&teg_square, all->of + k);
    for (int turn = 0; more; turn++) {
        more = 0;
        for (int k = 0; k < count; k++) {
            const int line = r->regions[k].first + turn;
            int state;
            if (line >= r->regions[k].end || !all->of[k].n) continue;
            state = teg_cut_by_line(r, line, all->label[line], all->of + k);
            if (state == TEG_UNCLEAR) return 0;
            if (state == TEG_NOTHING) all->of[k].n = 0;
            more = 1;
        }
    }
    return 1;
}

//: teg_is_seen
/* Find the line on which the key of a region is the base's, if there is one on its part; it has no part where it is behind the base. Returns
   0 where it is not clear. */
static int teg_is_seen(teg_arrangement *r, const teg_region *region, teg_pieces *all, int at)
{
    double g[3], tolerance;
    int state;
    all->key[at] = -1, all->over[at] = 0;
    if (!all->of[at].n || r->base < 0) return 1;
    tolerance = teg_key_difference(r, r->base, region->region, g);
    tolerance = teg_key_tolerance(g, tolerance);
    state = teg_which_side(all->of + at, g, tolerance);
    if (state == -1) all->of[at].n = 0;
    if (!state) all->key[at] = teg_key_line(r, r->base, region->region, g);
    return state != 2 && !r->failed;
}

//: teg_is_beyond
/* Whether a piece is beyond one of the lines of a region. */
static inline int teg_is_beyond(const teg_arrangement *r, const teg_region *region, const teg_piece *piece)
{
    int beyond = 0;
    for (int k = region->first; k < region->end; k++) {
        const teg_line *const g = r->lines + k;
        double d[TEG_PIECE];
        teg_on_corners(g->c, g->a, g->b, piece->x, piece->y, d);
        beyond |= teg_below_level(d, TEG_ON_LINE) == (1u << TEG_PIECE) - 1;
    }
    return beyond;
}

//: teg_are_beside
/* Whether one of the lines of two regions has one of them on each side. */
static inline int teg_are_beside(const teg_arrangement *r, int near, int far, const teg_pieces *all)
{
    return teg_is_beyond(r, r->regions + near, all->of + far) | teg_is_beyond(r, r->regions + far, all->of + near);
}

//: teg_edge_on
/* Where the edge of a piece with this label begins and ends, along a line, and how far from it; returns its number or -1. */
static int teg_edge_on(const teg_piece *piece, int label, const teg_line *line, double *ends)
{
    for (int i = 0; i < piece->n; i++) {
        const int j = i + 1 == piece->n ? 0 : i + 1;
        if (piece->label[i] != label) continue;
        ends[0] = line->a * piece->y[i] - line->b * piece->x[i], ends[1] = line->a * piece->y[j] - line->b * piece->x[j];
        ends[2] = fmax(fabs(line->c + line->a * piece->x[i] + line->b * piece->y[i]), fabs(line->c + line->a * piece->x[j] + line->b * piece->y[j]));
        return i;
    }
    return -1;
}

//: teg_share_edges
/* Give common edges of two regions that are beside one another the line of the nearer one, as cuts have it; returns 0 where edges on one line
   have a part in common and are not equal. */
static int teg_share_edges(const teg_arrangement *r, int near, int far, teg_pieces *all)
{
    const int first = r->regions[far].first;
    const uint64_t lines = ((uint64_t)1 << r->regions[far].end) - 1;
    for (int a = r->regions[near].first; a < r->regions[near].end; a++)
        for (unsigned same = (unsigned)((all->same[a] & lines) >> first); same; same &= same - 1) {
            const teg_line *const g = r->lines + a;
            const int b = first + teg_lowest_bit(same);
            double one[3], two[3];
            int edge;
            edge = teg_edge_on(all->of + far, all->label[b], g, two);
            if (edge < 0 || teg_edge_on(all->of + near, all->label[a], g, one) < 0) continue;
            if (fmin(fmax(one[0], one[1]), fmax(two[0], two[1])) - fmax(fmin(one[0], one[1]), fmin(two[0], two[1])) <= TEG_ON_LINE) continue;
            if (all->label[b] != 2 * b || all->label[a] != 2 * a) return 0;
            if (fmax(two[2], fmax(fabs(one[0] - two[1]), fabs(one[1] - two[0]))) > 0.25 * TEG_ON_LINE) return 0; /* more than rounding */
            all->of[far].label[edge] = all->label[b] = 2 * a + 1;
            all->lent |= 1u << near | 1u << far;
        }
    return 1;
}

//: teg_tie_on_side
/* Whether the keys of two regions are equal along a side of the square and not elsewhere. */
static inline int teg_tie_on_side(const teg_arrangement *r, int64_t one, int64_t two)
{
    double g[3], size = teg_key_difference(r, one, two, g), tolerance = TEG_ON_LINE * (fabs(g[1]) + fabs(g[2])) + TEG_KEY_ROUNDING * size;
    const double corners[4] = {fabs(g[0]), fabs(g[0] + g[1]), fabs(g[0] + g[2]), fabs(g[0] + g[1] + g[2])};
    int equal = 0;
    for (int k = 0; k < 4; k++) equal += corners[k] <= tolerance;
    if (equal < 2) return 0; /* nor are there two by the exact tolerance, which is less */
    tolerance = teg_key_tolerance(g, size), equal = 0;
    for (int k = 0; k < 4; k++) equal += corners[k] <= tolerance;
    return equal > 1 && equal < 4;
}

//: teg_signed_cell
/* One more cell, that of a piece; `hides` is the number of the region that hides it, or -1. */
static void teg_signed_cell(teg_arrangement *r, const teg_piece *piece, int region, int hides)
{
    teg_cell_of(r, piece, r->regions[region].region);
    if (r->failed) return;
    r->cells[r->cell_count - 1].weight = hides < 0 ? 1.0 : -1.0;
    r->cells[r->cell_count - 1].sides[0] = region, r->cells[r->cell_count - 1].sides[1] = hides;
}

//: teg_hide
/* Make the cells of what one of two regions hides of the other; returns 0 where it is not clear. */
static int teg_hide(teg_arrangement *r, int near, int far, teg_pieces *all)
{
    const int64_t one = r->regions[near].region, two = r->regions[far].region;
    teg_piece common, other;
    double g[3], tolerance;
    int whole, side, line = all->key[near];
    teg_copy_piece(all->of + far, &common);
    whole = teg_cut_by_region(r, r->regions + near, all->label, &common);
    if (whole <= TEG_PART && line >= 0) {
        const int cut = teg_cut_by_line(r, line, 2 * line, &common);
        whole = cut > whole ? cut : whole;
    }
    if (whole >= TEG_NOTHING) return whole == TEG_NOTHING;
    tolerance = teg_key_difference(r, two, one, g);
    tolerance = teg_key_tolerance(g, tolerance);
    side = teg_which_side(&common, g, tolerance);
    if (side == 1 && whole == TEG_WHOLE) all->of[far].n = 0;
    if (side == 2 || !all->of[far].n) return side != 2 && !(all->lent >> far & 1);
    all->over[near] |= 1u << far, all->over[far] |= 1u << near;
    all->hidden |= (unsigned)(side >= 0) << far | (unsigned)(side <= 0) << near;
    if (all->hidden & all->lent) return 0; /* cuts may give their common edges to the other one */
    if (side) teg_signed_cell(r, &common, side == 1 ? far : near, side == 1 ? near : far);
    else {
        line = teg_key_line(r, two, one, g), teg_copy_piece(&common, &other);
        if (r->failed || teg_cut_by_line(r, line, 2 * line, &common) != TEG_PART) return 0;
        if (teg_trim(&other, -r->lines[line].c, -r->lines[line].a, -r->lines[line].b, 2 * line + 1) != TEG_PART) return 0;
        teg_signed_cell(r, &common, far, near);
        teg_signed_cell(r, &other, near, far);
    }
    return !r->failed;
}

//: teg_is_one_over_one
/* Whether no three regions lie over one another, so that nothing is hidden twice. */
static int teg_is_one_over_one(const teg_arrangement *r, const teg_pieces *all)
{
    unsigned seen = 0;
    for (int k = 0; k < (int)r->region_count; k++) seen |= (unsigned)(all->of[k].n > 0) << k;
    for (int k = 0; k < (int)r->region_count; k++)
        for (int m = 0; m < k && seen >> k & 1; m++)
            if (all->over[k] & seen & 1u << m && all->over[k] & all->over[m] & seen) return 0;
    return 1;
}

//: teg_area
/* The area of a cell. */
static double teg_area(const teg_arrangement *r, const teg_cell *cell)
{
    const double *const x = r->x + cell->at, *const y = r->y + cell->at;
    double area = 0.0;
    for (int k = 1; k + 1 < cell->n; k++) area += (x[k] - x[0]) * (y[k + 1] - y[0]) - (x[k + 1] - x[0]) * (y[k] - y[0]);
    return 0.5 * area;
}

//: teg_keep_seen
/* Leave out cells of regions that are hidden, and add those of the others. Returns 0 where two together hide one. */
static int teg_keep_seen(teg_arrangement *r, const teg_pieces *all, const double *otherwise)
{
    double area[TEG_PIECES];
    size_t kept = 0;
    for (size_t k = 0; k < r->cell_count; k++) {
        const teg_cell cell = r->cells[k];
        if (all->of[cell.sides[0]].n && all->of[cell.sides[1]].n) r->cells[kept++] = cell;
    }
    r->cell_count = kept;
    for (int k = 0; k < (int)r->region_count; k++) {
        area[k] = 1.0;
        if (!all->of[k].n) continue;
        teg_signed_cell(r, all->of + k, k, -1);
        if (r->failed) return 0;
        if (all->over[k]) area[k] = teg_area(r, r->cells + r->cell_count - 1);
    }
    for (size_t k = 0; k < kept; k++) {
        const teg_cell *const cell = r->cells + k;
        area[cell->sides[0]] -= teg_area(r, cell);
        if (!teg_is_known(TEG_SHAPE(r->shape), teg_polynomials(r, cell->owner, otherwise))) return 0;
    }
    for (int k = 0; k < (int)r->region_count; k++)
        if (area[k] < TEG_BESIDE) return 0;
    return 1;
}

//: teg_may_have_signs
/* Whether a square is one whose cells may have signs: few regions are there, and some of their lines are one. */
static inline int teg_may_have_signs(teg_arrangement *r, const double *otherwise)
{
    const size_t count = r->region_count;
    if (count < 2 || count > TEG_PIECES || r->line_count > TEG_PIECE_LINES || TEG_SHAPE(r->shape)->parts > 1) return 0;
    r->alone = !teg_may_have_twins(r);
    return !r->alone && teg_is_known(TEG_SHAPE(r->shape), teg_polynomials(r, r->base, otherwise));
}

//: teg_sign_cells
/* Make the cells with signs of a square that may have them; returns 0 where they are not known to be right. */
TEG_APART int teg_sign_cells(teg_arrangement *r, const double *otherwise)
{
    teg_pieces all;
    unsigned beside[TEG_PIECES] = {0};
    const int count = (int)r->region_count;
    teg_sort_regions(r->regions, r->region_count);
    all.lent = all.hidden = 0;
    for (int k = 0; k < (int)r->line_count; k++) all.label[k] = 2 * k;
    if (!teg_cut_pieces(r, &all)) return 0;
    teg_find_same(r, &all);
    for (int k = 0; k < count; k++)
        if (!teg_is_seen(r, r->regions + k, &all, k)) return 0;
    for (int far = 1; far < count; far++)
        for (int near = 0; near < far; near++) {
            if (!all.of[near].n || !all.of[far].n) continue;
            beside[far] |= (unsigned)teg_are_beside(r, near, far, &all) << near;
            if (teg_tie_on_side(r, r->regions[near].region, r->regions[far].region)) return 0;
            if (beside[far] >> near & 1 && !teg_share_edges(r, near, far, &all)) return 0;
        }
    for (int k = 0; k < count; k++)
        if (all.of[k].n && all.key[k] >= 0 && teg_cut_by_line(r, all.key[k], 2 * all.key[k], all.of + k) != TEG_PART) return 0;
    for (int far = 1; far < count; far++)
        for (int near = 0; near < far; near++)
            if (all.of[near].n && all.of[far].n && !(beside[far] >> near & 1) && !teg_hide(r, near, far, &all)) return 0;
    return teg_is_one_over_one(r, &all) && teg_keep_seen(r, &all, otherwise);
}
