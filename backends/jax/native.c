/* A handler of XLA's foreign function interface through which a program of XLA calls compiled kernels of teg.

   A kernel is named by a number that is made of its text, not by its address: executables outlive a process in JAX's cache on disk. */
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include "xla/ffi/api/c_api.h"

typedef int teg_kernel(
    long n, const void *p, const long *stride, void *out, long *notes, int threads, long (*poll)(void *data), void *data);
typedef struct {
    const void *data;
    long stride;
    const int64_t *shape;
} teg_array;
typedef struct {
    const double *const *p;
    const teg_array *a;
} teg_given;

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

/* A batch of numbers that XLA's threads share: each takes parts until none is left; the last to leave frees the job. A task that starts
   late finds no part, so no thread waits for a task that has not begun. */
typedef struct {
    teg_kernel *kernel;
    const double **p, **results;
    long *stride;
    long inputs, outputs, n, each, parts, next, done;
    long noted;
    int failed, users;
} teg_job;

static void teg_leave(teg_job *job)
{
    if (!__atomic_sub_fetch(&job->users, 1, __ATOMIC_ACQ_REL)) free(job);
}

static void teg_part(teg_job *job, long i, const double **p, double *block, long *notes)
{
    const long first = i * job->each, n = job->n - first < job->each ? job->n - first : job->each;
    long noted = 0;
    for (long j = 0; j < job->inputs; j++) p[j] = job->p[j] + first * job->stride[j];
    memset(notes, 0, (size_t)n * sizeof *notes);
    if (job->kernel(n, p, job->stride, block, notes, 1, NULL, NULL)) __atomic_store_n(&job->failed, 1, __ATOMIC_RELAXED);
    for (long j = 0; j < job->outputs; j++) memcpy((double *)job->results[j] + first, block + j * n, (size_t)n * sizeof *block);
    for (long k = 0; k < n; k++) noted |= notes[k];
    __atomic_fetch_or(&job->noted, noted, __ATOMIC_RELAXED);
}

static void teg_work(teg_job *job)
{
    double *const block = malloc((size_t)(job->outputs * job->each) * sizeof *block);
    const double **const p = malloc((size_t)(job->inputs + 1) * sizeof *p);
    long *const notes = malloc((size_t)job->each * sizeof *notes);
    for (long i; (i = __atomic_fetch_add(&job->next, 1, __ATOMIC_RELAXED)) < job->parts;) {
        if (block && p && notes) teg_part(job, i, p, block, notes);
        else __atomic_store_n(&job->failed, 1, __ATOMIC_RELAXED);
        __atomic_add_fetch(&job->done, 1, __ATOMIC_RELEASE);
    }
    free(block), free(p), free(notes);
}

static void teg_task(void *data)
{
    teg_work(data);
    teg_leave(data);
}

/* Numbers: columns in, one column for each output. Returns the status; `noted` becomes the union of the notes. */
static int teg_numbers(const XLA_FFI_CallFrame *frame, teg_kernel *kernel, long n, long *noted)
{
    const XLA_FFI_Api *const api = frame->api;
    const int64_t inputs = frame->args.size, outputs = frame->rets.size;
    XLA_FFI_ThreadPool_NumThreads_Args ask = {XLA_FFI_ThreadPool_NumThreads_Args_STRUCT_SIZE, NULL, frame->ctx, NULL};
    int64_t threads = 1;
    ask.num_threads = &threads;
    if (n >= TEG_ALONE) {
        XLA_FFI_Error *const error = api->XLA_FFI_ThreadPool_NumThreads(&ask);
        if (error) dropped(api, error), threads = 1;
    }
    const size_t pointers = (size_t)(inputs + outputs + 1) * sizeof(double *), strides = (size_t)(inputs + 1) * sizeof(long);
    teg_job *const job = malloc(sizeof *job + pointers + strides);
    if (!job) return 1;
    *job = (teg_job){.kernel = kernel, .p = (const double **)(job + 1), .inputs = inputs, .outputs = outputs, .n = n};
    job->results = job->p + inputs, job->stride = (long *)(job->results + outputs + 1);
    for (int64_t i = 0; i < inputs; i++) {
        const XLA_FFI_Buffer *const b = frame->args.args[i];
        job->p[i] = b->data, job->stride[i] = b->rank > 0;
    }
    for (int64_t j = 0; j < outputs; j++) job->results[j] = ((XLA_FFI_Buffer *)frame->rets.rets[j])->data;
    job->each = threads == 1 ? n : (n + TEG_SHARES * threads - 1) / (TEG_SHARES * threads);
    if (threads > 1) job->each = (job->each + TEG_SIDE - 1) / TEG_SIDE * TEG_SIDE;
    if (job->each > TEG_MOST) job->each = TEG_MOST;
    job->parts = (n + job->each - 1) / job->each;
    const long others = threads - 1 < job->parts - 1 ? threads - 1 : job->parts - 1;
    job->users = 1 + (int)others;
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

/* Programs with arrays: `own` says of each operand how many axes an element of the batch has, -1 for a number of the program. */
static int teg_arrays(const XLA_FFI_CallFrame *frame, teg_kernel *kernel, const int64_t *own, long n, long *noted)
{
    const int64_t inputs = frame->args.size, outputs = frame->rets.size;
    const size_t each = sizeof(teg_array) + sizeof(double *) + sizeof(long);
    char *const space = malloc((size_t)(inputs + 1) * each + (size_t)(outputs + 1) * sizeof(void *) + (size_t)n * sizeof(long));
    if (!space) return 1;
    teg_array *const a = (teg_array *)space;
    const double **const p = (const double **)(a + inputs + 1);
    void **const out = (void **)(p + inputs + 1);
    long *const stride = (long *)(out + outputs + 1), *const notes = stride + inputs + 1;
    int64_t numbers = 0, arrays = 0;
    for (int64_t i = 0; i < inputs; i++) {
        const XLA_FFI_Buffer *const b = frame->args.args[i];
        if (own[i] < 0) {
            p[numbers] = b->data, stride[numbers++] = b->rank > 0;
            continue;
        }
        long size = 1;
        for (int64_t k = b->rank - own[i]; k < b->rank; k++) size *= b->dims[k];
        a[arrays++] = (teg_array){b->data, b->rank > own[i] ? size : 0, b->dims + (b->rank - own[i])};
    }
    for (int64_t j = 0; j < outputs; j++) {
        const XLA_FFI_Buffer *const b = frame->rets.rets[j];
        size_t size = sizeof(double);
        for (int64_t k = 0; k < b->rank; k++) size *= (size_t)b->dims[k];
        out[j] = memset(b->data, 0, size);
    }
    memset(notes, 0, (size_t)n * sizeof *notes);
    const teg_given given = {p, a};
    const int status = kernel(n, &given, stride, out, notes, 1, NULL, NULL);
    for (long k = 0; k < n; k++) *noted |= notes[k];
    free(space);
    return status;
}

/* Attributes: `kernel`, its number; `arrays`, whether it is a program with arrays; `own`, of operands and then of results (see teg_arrays);
   `inaccurate`, what is done where a tolerance was missed. */
XLA_FFI_Error *teg_native(XLA_FFI_CallFrame *frame)
{
    const XLA_FFI_Extension_Base *const more = frame->extension_start;
    if (more && more->type == XLA_FFI_Extension_Metadata) {
        XLA_FFI_Metadata *const m = ((XLA_FFI_Metadata_Extension *)more)->metadata;
        m->api_version.major_version = XLA_FFI_API_MAJOR, m->api_version.minor_version = XLA_FFI_API_MINOR;
        return NULL;
    }
    const XLA_FFI_Api *const api = frame->api;
    const XLA_FFI_Scalar *const number = attribute(&frame->attrs, "kernel", XLA_FFI_AttrType_SCALAR);
    const XLA_FFI_Scalar *const kind = attribute(&frame->attrs, "arrays", XLA_FFI_AttrType_SCALAR);
    const XLA_FFI_Scalar *const inaccurate = attribute(&frame->attrs, "inaccurate", XLA_FFI_AttrType_SCALAR);
    const XLA_FFI_Array *const own = attribute(&frame->attrs, "own", XLA_FFI_AttrType_ARRAY);
    if (!number || !kind || !inaccurate || !own || own->size != (size_t)(frame->args.size + frame->rets.size))
        return failure(api, XLA_FFI_Error_Code_INVALID_ARGUMENT, "teg: this call was compiled by another version of teg");
    teg_entry *const entry = teg_find(*(const int64_t *)number->value);
    if (!entry)
        return failure(
            api, XLA_FFI_Error_Code_NOT_FOUND, "teg: the kernel of this call was compiled in another process; call the function in this one first");
    if (!frame->rets.size) return NULL;
    const int64_t *const dims = own->data;
    const XLA_FFI_Buffer *const first = frame->rets.rets[0];
    long n = 1, noted = 0;
    for (int64_t k = 0; k < first->rank - (dims[frame->args.size] < 0 ? 0 : dims[frame->args.size]); k++) n *= first->dims[k];
    if (!n) return NULL;
    __atomic_fetch_add(&calls, 1, __ATOMIC_RELAXED);
    const int arrays = *(const int32_t *)kind->value, answer = *(const int32_t *)inaccurate->value;
    const int status = arrays ? teg_arrays(frame, entry->kernel, dims, n, &noted) : teg_numbers(frame, entry->kernel, n, &noted);
    if (status) return failure(api, XLA_FFI_Error_Code_RESOURCE_EXHAUSTED, "teg: there is no memory for the kernel's workspace");
    if (noted & (TEG_MISSED | TEG_CROWDED)) {
        if (answer == TEG_RAISE) return failure(api, XLA_FFI_Error_Code_INTERNAL, entry->text);
        if (answer == TEG_WARN) teg_warn(entry);
    }
    return NULL;
}
