/* Lines of several candidates that lie on each other, and who has a share in an edge. */

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
    size_t count = r->line_count;
    int found = count > TEG_FEW;
    while (count > 4 && r->lines[count - 1].minus >= 0) count--; /* those of keys are last */
    for (size_t i = 4; i < count && !found; i++) {
        const teg_line *const g = r->lines + i;
        int near = 0;
        for (size_t j = (size_t)g->end; j < count; j++) near |= fabs(fabs(g->c) - fabs(r->lines[j].c)) < 2.0 * TEG_SAME;
        for (size_t j = (size_t)g->end; j < count && near; j++) { /* those of the regions behind this one's */
            const teg_line *const h = r->lines + j;
            const double across = g->a * h->b - g->b * h->a, along = g->a * h->a + g->b * h->b;
            found |= (fabs(across) < 8.0 / TEG_ANGLES) & (fabs(along < 0.0 ? g->c + h->c : g->c - h->c) < 2.0 * TEG_SAME);
        }
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
