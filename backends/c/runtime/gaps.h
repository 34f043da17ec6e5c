//: teg_gaps
/* The gaps between first and last that candidates leave. `ends` are first the intervals that are covered, then the gaps but for the last one,
   (p, q) each; `lost` where one is not known, or there was no memory; `closed` once a candidate covers all of the line. */
typedef struct {
    double first, last, *ends;
    int64_t size, room;
    int lost, full, doubtful, closed;
} teg_gaps;

//: teg_add_covered
/* Add what a candidate covers: n places, whether the n + 1 pieces between them are covered, what counts where these are ties, and whether it is
   not known well where borders cross. */
static void teg_add_covered(teg_gaps *g, int n, const double *values)
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
            double *const ends = realloc(g->ends, (size_t)room * 2 * sizeof *ends);
            if (!ends) {
                g->lost = g->full = 1;
                return;
            }
            g->ends = ends, g->room = room;
        }
        g->ends[2 * g->size] = p, g->ends[2 * g->size + 1] = q;
        g->size++;
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
    double end = g->first;
    if (g->size > 1)
        qsort(g->ends, (size_t)g->size, 2 * sizeof *g->ends, teg_by_begin);
    for (int64_t k = 0; k < g->size && !g->lost; k++) {
        const double p = g->ends[2 * k], q = g->ends[2 * k + 1];
        if (teg_is_piece(end, p)) {
            g->ends[2 * found] = end, g->ends[2 * found + 1] = p;
            found++;
        }
        end = fmax(end, q);
    }
    g->first = end;
    return found;
}
