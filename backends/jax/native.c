/* A handler of XLA's foreign function interface through which a program of XLA calls compiled kernels of teg.

   A kernel is named by a number that is made of its text, not by its address: executables outlive a process in JAX's cache on disk. */
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include "xla/ffi/api/c_api.h"

typedef struct {
    const void *data;
    long stride;
    const int64_t *shape;
} teg_array;
typedef int teg_kernel(
    long n, const double *const *p, const long *stride, const teg_array *a, double *const *out, long *notes, int threads,
    long (*poll)(void *data), void *data);

/* Functions of Python's, and the class of the warning. */
typedef struct {
    int (*later)(int (*function)(void *), void *data);
    int (*warn)(void *category, const char *text, long level);
    void *category;
} teg_python;

enum { TEG_BUCKETS = 256, TEG_IGNORE = 0, TEG_WARN = 1, TEG_RAISE = 2, TEG_ALONE = 64, TEG_SHARES = 16, TEG_SIDE = 8, TEG_MOST = 4096 };
/* Bits of a note: a tolerance was missed, there was too little room for roots. */
enum { TEG_MISSED = 2, TEG_CROWDED = 4 };

typedef struct teg_entry {
    int64_t number;
    teg_kernel *kernel;
    const char *text;  /* what is said of a missed tolerance */
    int told;          /* the warning waits for the main thread */
    struct teg_entry *next;
} teg_entry;

/* Lists that only grow: read without a lock. */
static teg_entry *table[TEG_BUCKETS];
static teg_python python;
static long calls;

static teg_entry *teg_find(int64_t number)
{
    teg_entry *e = __atomic_load_n(&table[number & (TEG_BUCKETS - 1)], __ATOMIC_ACQUIRE);
    while (e && e->number != number) e = e->next;
    return e;
}

/* Give a kernel its number. Callers hold a lock. Returns 1 without memory. */
int teg_native_bind(int64_t number, void *kernel, const char *text)
{
    if (teg_find(number)) return 0;
    teg_entry *const e = malloc(sizeof *e);
    char *const copy = malloc(strlen(text) + 1);
    if (!e || !copy) {
        free(e), free(copy);
        return 1;
    }
    teg_entry **const bucket = &table[number & (TEG_BUCKETS - 1)];
    *e = (teg_entry){number, (teg_kernel *)kernel, strcpy(copy, text), 0, *bucket};
    __atomic_store_n(bucket, e, __ATOMIC_RELEASE);
    return 0;
}

void teg_native_start(void *later, void *warn, void *category)
{
    memcpy(&python.later, &later, sizeof later), memcpy(&python.warn, &warn, sizeof warn), python.category = category;
}

/* How many calls there were, for tests. */
long teg_native_calls(void) { return __atomic_load_n(&calls, __ATOMIC_RELAXED); }

static XLA_FFI_Error *failure(const XLA_FFI_Api *api, XLA_FFI_Error_Code code, const char *text)
{
    XLA_FFI_Error_Create_Args args = {XLA_FFI_Error_Create_Args_STRUCT_SIZE, NULL, text, code};
    return api->XLA_FFI_Error_Create(&args);
}

static void dropped(const XLA_FFI_Api *api, XLA_FFI_Error *error)
{
    XLA_FFI_Error_Destroy_Args args = {XLA_FFI_Error_Destroy_Args_STRUCT_SIZE, NULL, error};
    if (error) api->XLA_FFI_Error_Destroy(&args);
}

static const void *attribute(const XLA_FFI_Attrs *attrs, const char *name, XLA_FFI_AttrType type)
{
    for (int64_t i = 0; i < attrs->size; i++) {
        const XLA_FFI_ByteSpan *const s = attrs->names[i];
        if (s->len == strlen(name) && !memcmp(s->ptr, name, s->len)) return attrs->types[i] == type ? attrs->attrs[i] : NULL;
    }
    return NULL;
}

/* In the main thread, with Python's lock: an error of Python's if warnings are errors. */
static int teg_warned(void *data)
{
    teg_entry *const e = data;
    __atomic_store_n(&e->told, 0, __ATOMIC_RELEASE);
    return python.warn(python.category, e->text, 1);
}

static void teg_warn(teg_entry *e)
{
    if (!__atomic_exchange_n(&e->told, 1, __ATOMIC_ACQ_REL) && python.later(teg_warned, e)) __atomic_store_n(&e->told, 0, __ATOMIC_RELEASE);
}

/* A batch that XLA's threads share: each takes parts until none is left; the last to leave frees the job. A task that starts late finds no
   part, so no thread waits for a task that has not begun. */
typedef struct {
    teg_kernel *kernel;
    const double **p;      /* the numbers, and how far it is from one element of the batch to the next: 0 or 1 */
    long *stride;
    teg_array *a;          /* the arrays */
    double **out;          /* the results, and how many numbers each has an element */
    long *size;
    long numbers, arrays, outputs, n, each, parts, next, done, noted;
    int failed, users;
} teg_job;

static void teg_leave(teg_job *job)
{
    if (!__atomic_sub_fetch(&job->users, 1, __ATOMIC_ACQ_REL)) free(job);
}

/* Places for the arguments of one part. */
static void *teg_room(const teg_job *job)
{
    return malloc((size_t)(job->arrays + 1) * sizeof(teg_array) + (size_t)(job->numbers + job->outputs + 1) * sizeof(double *)
                  + (size_t)job->each * sizeof(long));
}

static void teg_part(teg_job *job, long i, void *room)
{
    const long first = i * job->each, n = job->n - first < job->each ? job->n - first : job->each;
    teg_array *const a = room;
    const double **const p = (const double **)(a + job->arrays + 1);
    double **const out = (double **)(p + job->numbers);
    long *const notes = (long *)(out + job->outputs + 1), noted = 0;
    for (long j = 0; j < job->numbers; j++) p[j] = job->p[j] + first * job->stride[j];
    for (long j = 0; j < job->arrays; j++) {
        a[j] = job->a[j];
        a[j].data = (const double *)a[j].data + first * a[j].stride;  /* of 8 bytes, as integers are */
    }
    for (long j = 0; j < job->outputs; j++) out[j] = job->out[j] + first * job->size[j];
    memset(notes, 0, (size_t)n * sizeof *notes);
    if (job->kernel(n, p, job->stride, a, out, notes, 1, NULL, NULL)) __atomic_store_n(&job->failed, 1, __ATOMIC_RELAXED);
    for (long k = 0; k < n; k++) noted |= notes[k];
    __atomic_fetch_or(&job->noted, noted, __ATOMIC_RELAXED);
}

static void teg_work(teg_job *job)
{
    void *const room = teg_room(job);
    for (long i; (i = __atomic_fetch_add(&job->next, 1, __ATOMIC_RELAXED)) < job->parts;) {
        if (room) teg_part(job, i, room);
        else __atomic_store_n(&job->failed, 1, __ATOMIC_RELAXED);
        __atomic_add_fetch(&job->done, 1, __ATOMIC_RELEASE);
    }
    free(room);
}

static void teg_task(void *data)
{
    teg_work(data);
    teg_leave(data);
}

/* A job for a batch of n: `own` says of each operand how many axes an element has, -1 for a number of the program, and then of each result.
   NULL without memory. */
static teg_job *teg_prepared(const XLA_FFI_CallFrame *frame, teg_kernel *kernel, const int64_t *own, long n)
{
    const int64_t inputs = frame->args.size, outputs = frame->rets.size;
    const size_t an_input = sizeof(teg_array) + sizeof(double *) + sizeof(long), a_result = sizeof(double *) + sizeof(long);
    teg_job *const job = malloc(sizeof *job + (size_t)(inputs + 1) * an_input + (size_t)(outputs + 1) * a_result);
    if (!job) return NULL;
    *job = (teg_job){.kernel = kernel, .a = (teg_array *)(job + 1), .outputs = outputs, .n = n, .users = 1};
    job->p = (const double **)(job->a + inputs + 1), job->stride = (long *)(job->p + inputs + 1);
    job->out = (double **)(job->stride + inputs + 1), job->size = (long *)(job->out + outputs + 1);
    for (int64_t i = 0; i < inputs; i++) {
        const XLA_FFI_Buffer *const b = frame->args.args[i];
        if (own[i] < 0) {
            job->p[job->numbers] = b->data, job->stride[job->numbers++] = b->rank > 0;
            continue;
        }
        long size = 1;
        for (int64_t k = b->rank - own[i]; k < b->rank; k++) size *= b->dims[k];
        job->a[job->arrays++] = (teg_array){b->data, b->rank > own[i] ? size : 0, b->dims + (b->rank - own[i])};
    }
    for (int64_t j = 0; j < outputs; j++) {
        const XLA_FFI_Buffer *const b = frame->rets.rets[j];
        job->out[j] = b->data, job->size[j] = 1;
        for (int64_t k = b->rank - own[inputs + j]; k < b->rank; k++) job->size[j] *= b->dims[k];
        if (own[inputs + j]) memset(b->data, 0, (size_t)(n * job->size[j]) * sizeof(double));  /* what is shaped like an array is added to */
    }
    return job;
}

/* Run a batch, with the help of XLA's threads if it is large. Returns the status; `noted` becomes the union of the notes. */
static int teg_run(const XLA_FFI_CallFrame *frame, teg_kernel *kernel, const int64_t *own, long n, long *noted)
{
    const XLA_FFI_Api *const api = frame->api;
    teg_job *const job = teg_prepared(frame, kernel, own, n);
    if (!job) return 1;
    int64_t threads = 1;
    if (n >= TEG_ALONE || (job->arrays && n > 1)) {
        XLA_FFI_ThreadPool_NumThreads_Args ask = {XLA_FFI_ThreadPool_NumThreads_Args_STRUCT_SIZE, NULL, frame->ctx, &threads};
        XLA_FFI_Error *const error = api->XLA_FFI_ThreadPool_NumThreads(&ask);
        if (error) dropped(api, error), threads = 1;
    }
    job->each = threads == 1 ? n : (n + TEG_SHARES * threads - 1) / (TEG_SHARES * threads);
    if (threads > 1 && !job->arrays) job->each = (job->each + TEG_SIDE - 1) / TEG_SIDE * TEG_SIDE;
    if (job->each > TEG_MOST) job->each = TEG_MOST;
    job->parts = (n + job->each - 1) / job->each;
    const long others = threads - 1 < job->parts - 1 ? threads - 1 : job->parts - 1;
    job->users += (int)others;
    for (long i = 0; i < others; i++) {
        XLA_FFI_ThreadPool_Schedule_Args go = {XLA_FFI_ThreadPool_Schedule_Args_STRUCT_SIZE, NULL, frame->ctx, teg_task, job};
        XLA_FFI_Error *const error = api->XLA_FFI_ThreadPool_Schedule(&go);
        if (error) dropped(api, error), teg_leave(job);
    }
    teg_work(job);
    while (__atomic_load_n(&job->done, __ATOMIC_ACQUIRE) < job->parts) sched_yield();
    const int failed = job->failed;
    *noted = job->noted;
    teg_leave(job);
    return failed;
}

/* Attributes: `kernel`, its number; `own`, of operands and then of results (see teg_prepared); `inaccurate`, what is done where a tolerance
   was missed. */
XLA_FFI_Error *teg_native(XLA_FFI_CallFrame *frame)
{
    const XLA_FFI_Metadata_Extension *const more = (const void *)frame->extension_start;  /* the type of it has two names, by the version of jaxlib */
    if (more && more->extension_base.type == XLA_FFI_Extension_Metadata) {
        XLA_FFI_Metadata *const m = more->metadata;
        m->api_version.major_version = XLA_FFI_API_MAJOR, m->api_version.minor_version = XLA_FFI_API_MINOR;
        return NULL;
    }
    const XLA_FFI_Api *const api = frame->api;
    const XLA_FFI_Scalar *const number = attribute(&frame->attrs, "kernel", XLA_FFI_AttrType_SCALAR);
    const XLA_FFI_Scalar *const inaccurate = attribute(&frame->attrs, "inaccurate", XLA_FFI_AttrType_SCALAR);
    const XLA_FFI_Array *const own = attribute(&frame->attrs, "own", XLA_FFI_AttrType_ARRAY);
    if (!number || !inaccurate || !own || own->size != (size_t)(frame->args.size + frame->rets.size))
        return failure(api, XLA_FFI_Error_Code_INVALID_ARGUMENT, "teg: this call was compiled by another version of teg");
    teg_entry *const entry = teg_find(*(const int64_t *)number->value);
    if (!entry)
        return failure(
            api, XLA_FFI_Error_Code_NOT_FOUND, "teg: the kernel of this call was compiled in another process; call the function in this one first");
    if (!frame->rets.size) return NULL;
    const int64_t *const dims = own->data;
    const XLA_FFI_Buffer *const first = frame->rets.rets[0];
    long n = 1, noted = 0;
    for (int64_t k = 0; k < first->rank - dims[frame->args.size]; k++) n *= first->dims[k];
    if (!n) return NULL;
    __atomic_fetch_add(&calls, 1, __ATOMIC_RELAXED);
    const int answer = *(const int32_t *)inaccurate->value;
    if (teg_run(frame, entry->kernel, dims, n, &noted))
        return failure(api, XLA_FFI_Error_Code_RESOURCE_EXHAUSTED, "teg: there is no memory for the kernel's workspace");
    if (noted & (TEG_MISSED | TEG_CROWDED)) {
        if (answer == TEG_RAISE) return failure(api, XLA_FFI_Error_Code_INTERNAL, entry->text);
        if (answer == TEG_WARN) teg_warn(entry);
    }
    return NULL;
}
