/* What a call knows: how ties are decided, what was noted, what can stop it, what threads share. */

//: teg_chunks
/* Into how many chunks a loop is cut whose iterations cost so many operations, and add to so many numbers. */
static inline long teg_chunks(int64_t iterations, int64_t cost, int64_t size)
{
    const double total = (double)iterations * (double)cost / (TEG_LEAST + 4.0 * (double)size);
    int64_t chunks = total < TEG_CHUNKS ? (int64_t)total : TEG_CHUNKS;
    if (size > 0 && chunks > TEG_COPIES / size) chunks = TEG_COPIES / size;
    return chunks < 1 || iterations < 1 ? 1 : chunks < iterations ? (long)chunks : (long)iterations;
}

//: teg_listed
/* Which of so many rows are among these entries; NULL without memory. */
static unsigned char *teg_listed(const int64_t *entries, int64_t count, int64_t rows)
{
    unsigned char *const listed = calloc((size_t)rows + 1, 1);
    for (int64_t k = 0; listed && k < count; k++)
        if ((uint64_t)entries[k] < (uint64_t)rows) listed[entries[k]] = 1;
    return listed;
}

//: teg_ahead
/* Ask for the row of a table that an entry of a list names, which is read soon; entries outside of the list name none. */
static inline void teg_ahead(const int64_t *list, int64_t count, int64_t at, const double *table, int width)
{
#ifdef __GNUC__
    if (at < count)
        for (int k = 0; k < width; k += 8) __builtin_prefetch((const void *)((uintptr_t)table + 8 * ((uintptr_t)list[at] * (uintptr_t)width + k)));
#endif
}

//: teg_reserve
/* Keep memory for tables in the process: glibc gives blocks back to the system that are larger than the largest one which was freed before, so
   that each of their pages is a fault in the next call. A block of four times the numbers, for the table and its copies, is freed at once. */
static void teg_reserve(int64_t numbers)
{
    void *volatile const block = malloc(4 * (size_t)numbers * sizeof(double));
    free(block);
}

//: teg_copies
/* Copies of what chunks add to, `targets` arrays of these sizes. A copy has so many `numbers` and as many `bytes` of marks behind them; with
   one chunk it has marks only. Copies of chunks that are done wait in `finished` until all before are; `next` is the first that is not
   merged. Those that are not in use are `unused`. */
typedef struct {
    int targets;
    long chunks;
    double *const *originals;
    const int64_t *sizes;
    size_t numbers, bytes;
    long next, count;
    double **finished, **unused, **spare;
} teg_copies;

//: teg_open
/* Returns 1 without memory. */
static int teg_open(teg_copies *copies)
{
    for (int k = 0; k < copies->targets; k++) {
        if (copies->chunks > 1) copies->numbers += (size_t)copies->sizes[k];
        copies->bytes += ((size_t)copies->sizes[k] >> TEG_MARKED) + 1;
    }
    copies->spare = calloc(2 * (size_t)copies->chunks, sizeof *copies->spare);
    copies->finished = copies->spare, copies->unused = copies->spare + copies->chunks;
    return !copies->spare;
}

//: teg_take
/* A copy that is 0, or NULL without memory. */
static double *teg_take(teg_copies *copies)
{
    return copies->count ? copies->unused[--copies->count] : calloc(1, copies->numbers * sizeof(double) + copies->bytes);
}

//: teg_merge
/* Add a copy to the originals where it is marked, and clear it. */
static void teg_merge(const teg_copies *copies, double *copy)
{
    unsigned char *marks = (unsigned char *)(copy + copies->numbers);
    for (int k = 0; k < copies->targets; k++) {
        const int64_t size = copies->sizes[k], blocks = (size >> TEG_MARKED) + 1;
        double *const into = copies->originals[k];
        for (int64_t block = 0; block < blocks; block++) {
            const int64_t first = block << TEG_MARKED, end = first + (1 << TEG_MARKED) < size ? first + (1 << TEG_MARKED) : size;
            if (!marks[block]) continue;
            marks[block] = 0;
            for (int64_t i = first; i < end; i++) into[i] += copy[i], copy[i] = 0.0;
        }
        copy += size, marks += blocks;
    }
}

//: teg_finish
/* Note that a chunk is done; merge copies as long as the next one is done. */
static void teg_finish(teg_copies *copies, long chunk, double *copy)
{
    copies->finished[chunk] = copy;
    for (; copies->next < copies->chunks && copies->finished[copies->next]; copies->next++) {
        double *const done = copies->finished[copies->next];
        if (copies->chunks > 1) teg_merge(copies, done);
        copies->finished[copies->next] = NULL, copies->unused[copies->count++] = done;
    }
}

//: teg_close
/* Free all copies. */
static void teg_close(teg_copies *copies)
{
    for (long k = 0; copies->spare && k < copies->chunks; k++) free(copies->finished[k]);
    for (long k = 0; k < copies->count; k++) free(copies->unused[k]);
    free(copies->spare);
}

//: teg_watch
/* What can stop a call: the thread that called asks `poll`, which tells after how much more work to ask again, or 0 to stop. */
typedef struct {
    long (*poll)(void *data);
    void *data;
    int stopped;
} teg_watch;

//: teg_pace
/* How much work a thread may do before it asks. */
typedef struct {
    teg_watch *watch;
    int caller;
    long left;
} teg_pace;

//: teg_ask
/* Whether the call was stopped; sets how much work may be done before this is called again. */
static int teg_ask(teg_pace *pace)
{
    teg_watch *const watch = pace->watch;
    int stopped;
    pace->left = 0;
#ifdef _OPENMP
#pragma omp atomic read
#endif
    stopped = watch->stopped;
    if (stopped) return 1;
    pace->left = pace->caller && watch->poll ? watch->poll(watch->data) : 16;
    if (pace->left > 0) return 0;
#ifdef _OPENMP
#pragma omp atomic write
#endif
    watch->stopped = 1;
    return 1;
}

//: teg_stopped
/* Count a piece of work, before it is begun. Returns whether it is to be left out, as all the rest: the call was stopped. */
static inline int teg_stopped(teg_pace *pace)
{
    return --pace->left < 0 && teg_ask(pace);
}

//: teg_wait
/* Wait until no thread works any more, and keep asking. */
static inline void teg_wait(teg_pace *pace, int *working)
{
    int others = 0;
#ifdef _OPENMP
#pragma omp atomic
#endif
    --*working;
    if (!pace->caller || !pace->watch->poll) return;
    do {
#ifdef _OPENMP
#pragma omp atomic read
#endif
        others = *working;
    } while (others > 0 && !teg_ask(pace));
}

//: teg_context
/* How coinciding surfaces are ordered in this run (+1 or -1; +2 and -2: all their ties are true, or false), whether any were
   met, a tolerance was missed, and a search had too little room; the evaluations, if they are counted, and those of adaptive
   integrals; what may stop it. */
typedef struct {
    int order, tied, missed, crowded;
    long evaluations, work;
    teg_pace *pace;
} teg_context;

//: teg_differ
/* Whether results differ, relative to the largest of them; NaN is the same as NaN. */
static int teg_differ(const double *one, const double *other, int n)
{
    double most = 0.0;
    for (int j = 0; j < n; j++)
        if (isfinite(one[j]) && fabs(one[j]) > most) most = fabs(one[j]);
    for (int j = 0; j < n; j++) {
        const int same = one[j] == other[j] || (isnan(one[j]) && isnan(other[j]));
        if (!same && !(fabs(one[j] - other[j]) <= TEG_WEIGHED * most)) return 1;
    }
    return 0;
}

//: teg_tie
static inline int teg_tie(teg_context *ctx, double g, double scale, int r)
{
    if (fabs(g) <= TEG_TIE_EPS * scale && isfinite(g)) {
        ctx->tied = 1;
        if (ctx->order > 1 || ctx->order < -1) r = 1;
        return ctx->order > 0 ? r : !r;
    }
    return g > 0.0;
}
