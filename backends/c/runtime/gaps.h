//: teg_gaps
/* The gaps between first and last that candidates leave. `ends` are first the intervals that are covered, then the gaps but for the last one,
   each with `width` numbers: p, q, and if ends move their velocities; `lost` where one is not known, or there was no memory; `closed` once
   a candidate covers all of the line. `outer` is the velocity of first. */
typedef struct {
    double first, last, *ends;
    int64_t size, room;
    int lost, full, doubtful, closed, width;
    double outer;
} teg_gaps;

//: teg_add_covered
/* Add what a candidate covers: n places, whether the n + 1 pieces between them are covered, what counts where these are ties, and whether it is
   not known well where borders cross; and the velocities of the places, if ends move. */
static void teg_add_covered(teg_gaps *g, int n, const double *values, const double *velocities)
{
    const double *const flags = values + n, *const ties = flags + n + 1, touch = TEG_TOUCHING * (g->last - g->first);
    double before = -1.0;
    g->doubtful += ties[n + 1] > 0.0;
    for (int i = 0; i <= n && before < 0.0; i++) {
        const double p = i ? fmin(values[i - 1], g->last) : g->first, q = i < n ? fmin(values[i], g->last) : g->last;
        const int tie = flags[i] >= TEG_TIE_FROM && flags[i] <= TEG_TIE_TO;
        before = !tie ? flags[i] : q - p < touch ? -1.0 : ties[i];
    }
    g->closed = !(ties[n + 1] > 0.0);
    for (int i = 0; i <= n; i++) {
        const double p = i ? fmin(values[i - 1], g->last) : g->first, q = i < n ? fmin(values[i], g->last) : g->last;
        const int tie = flags[i] >= TEG_TIE_FROM && flags[i] <= TEG_TIE_TO;
        before = !tie ? flags[i] : q - p < touch ? before : ties[i];
        g->lost |= isnan(before) || (i < n && isnan(values[i]));
        g->closed &= before > TEG_TIE_TO || p >= q;
        if (!(before > TEG_TIE_TO) || !teg_is_piece(p, q))
            continue;
        if (g->size == g->room) {
            const int64_t room = 2 * g->room + 16;
            double *const ends = realloc(g->ends, (size_t)(room * g->width) * sizeof *ends);
            if (!ends) {
                g->lost = g->full = 1;
                return;
            }
            g->ends = ends, g->room = room;
        }
        double *const piece = g->ends + g->width * g->size++;
        piece[0] = p, piece[1] = q;
        if (g->width > 2) /* those of first and last are not asked for: nothing is seen on the other side */
            piece[2] = i ? velocities[i - 1] : 0.0, piece[3] = i < n ? velocities[i] : 0.0;
    }
}

//: teg_by_begin
static int teg_by_begin(const void *a, const void *b)
{
    const double p = *(const double *)a, q = *(const double *)b;
    return (p > q) - (p < q);
}

//: teg_find_gaps
/* Make gaps of what is covered. Returns how many there are before the last one, which begins at `first` now, and may be empty. */
static int64_t teg_find_gaps(teg_gaps *g)
{
    int64_t found = 0;
    double end = g->first, velocity = g->outer;
    if (g->size > 1)
        qsort(g->ends, (size_t)g->size, (size_t)g->width * sizeof *g->ends, teg_by_begin);
    for (int64_t k = 0; k < g->size && !g->lost; k++) {
        const double *const piece = g->ends + g->width * k, p = piece[0], q = piece[1];
        const double begins = g->width > 2 ? piece[2] : 0.0, ends = g->width > 2 ? piece[3] : 0.0;
        if (teg_is_piece(end, p)) {
            double *const gap = g->ends + g->width * found++;
            gap[0] = end, gap[1] = p;
            if (g->width > 2)
                gap[2] = velocity, gap[3] = begins;
        }
        if (q > end)
            end = q, velocity = ends;
    }
    g->first = end, g->outer = velocity;
    return found;
}
