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
/* How coinciding surfaces are ordered in this run (+1 or -1), whether any were met, a tolerance was missed, and a search had too
   little room; the evaluations, if they are counted, and those of adaptive integrals; what may stop it. */
typedef struct {
    int order, tied, missed, crowded;
    long evaluations, work;
    teg_pace *pace;
} teg_context;

//: teg_tie
static inline int teg_tie(teg_context *ctx, double g, double scale, int r)
{
    if (fabs(g) <= TEG_TIE_EPS * scale && isfinite(g)) {
        ctx->tied = 1;
        return ctx->order > 0 ? r : !r;
    }
    return g > 0.0;
}
