/* Integrals of the polynomial of the nearest candidate over the unit interval, where no number belongs to the second variable: keys are
   straight lines, and those that are least somewhere are the hull of their points (rate, constant). Sorted by rate it is found with a stack
   (Andrew 1979), in n*log(n) for n candidates. Whatever is nearly a tie is left to teg_cells. */

//: teg_ray
/* A key, at + rate*u, of a row of candidates; it is the least one from `from` on. */
typedef struct {
    double rate, at, from;
    int64_t row;
} teg_ray;

//: teg_rays
/* The keys of all candidates that are present; returns their number, -1 if one is present on a part of the interval only, or is no number. */
static int64_t teg_rays(const teg_shape *s, int64_t n, const double *rows, teg_ray *keys)
{
    const int forms = teg_forms(s), width = teg_wide(s);
    int64_t count = 0;
    double sizes = 0.0;
    for (int64_t k = 0; k < n; k++) {
        const double *const row = rows + k * width;
        int present = 1;
        for (int q = 0; q < s->guards; q++) {
            const double at = row[3 * q], rate = row[3 * q + 1], margin = TEG_BESIDE * fabs(rate);
            const double least = at + (rate < 0.0 ? rate : 0.0), most = at + (rate > 0.0 ? rate : 0.0);
            if (least > margin && most < INFINITY) continue;
            if (!(most < -margin && least > -INFINITY)) return -1;
            present = 0;
        }
        if (!present) continue;
        keys[count].at = row[forms - 3], keys[count].rate = row[forms - 2], keys[count].row = k;
        sizes += fabs(keys[count].at) + fabs(keys[count].rate), count++;
    }
    return sizes < INFINITY ? count : -1;
}

//: teg_lowest_at
/* The key that is least at a place. */
static int64_t teg_lowest_at(const teg_ray *keys, int64_t count, double u)
{
    int64_t lowest = 0;
    double least = INFINITY;
    for (int64_t k = 0; k < count; k++) {
        const double value = keys[k].at + keys[k].rate * u;
        if (value < least) least = value, lowest = k;
    }
    return lowest;
}

//: teg_equal_at
/* Where two keys are equal, in the interval. */
static double teg_equal_at(const teg_ray *one, const teg_ray *two)
{
    const double u = (two->at - one->at) / (one->rate - two->rate);
    return u > 0.0 ? u < 1.0 ? u : 1.0 : 0.0;
}

//: teg_without_hidden
/* Leave out keys that are nowhere as low as three of them: those that are least at the ends, and where these two are equal. What touches one
   of them stays, also at an end. Returns how many remain. */
static int64_t teg_without_hidden(teg_ray *keys, int64_t count)
{
    const teg_ray first = keys[teg_lowest_at(keys, count, 0.0)], last = keys[teg_lowest_at(keys, count, 1.0)];
    const teg_ray middle = keys[teg_lowest_at(keys, count, teg_equal_at(&first, &last))];
    const double u = teg_equal_at(&first, &middle), v = teg_equal_at(&middle, &last);
    const double low = middle.at + middle.rate * u, high = middle.at + middle.rate * v, end = last.at + last.rate;
    const double sizes = fabs(first.at) + fabs(low) + fabs(high) + fabs(end);
    int64_t kept = 0;
    for (int64_t k = 0; k < count; k++) {
        const teg_ray key = keys[k];
        const double margin = TEG_BESIDE * (fabs(key.at) + fabs(key.rate) + sizes);
        const int inside = key.at + key.rate * u < low + margin || key.at + key.rate * v < high + margin;
        keys[kept] = key;
        kept += inside || key.at < first.at + margin || key.at + key.rate < end + margin;
    }
    return kept;
}

//: teg_by_rate
static int teg_by_rate(const void *a, const void *b)
{
    const teg_ray *const p = a, *const q = b;
    return p->rate > q->rate ? -1 : p->rate < q->rate ? 1 : p->row < q->row ? -1 : 1;
}

//: teg_sort_by_rate
/* Put keys in the order of their rates, the largest first: if they are not many by counting, for each, those that are before it. */
static void teg_sort_by_rate(teg_ray *keys, int64_t count)
{
    double rates[TEG_SOME], places[TEG_SOME], pairs = 0.0;
    teg_ray sorted[TEG_SOME];
    if (count <= TEG_SOME) {
        const int lanes = ((int)count + 7) & ~7;
        for (int k = 0; k < lanes; k++) rates[k] = k < count ? keys[k].rate : INFINITY, places[k] = 0.0;
        for (int j = 0; j < count; j++) {
            const double rate = rates[j];
            for (int from = 0; from < lanes; from += 8)
                for (int k = from; k < from + 8; k++) places[k] += rate > rates[k] ? 1.0 : 0.0;
        }
        for (int k = 0; k < lanes; k++) pairs += places[k];
    }
    if (count > TEG_SOME || pairs < 0.5 * (double)(count * (count - 1))) { /* or some are equal */
        qsort(keys, (size_t)count, sizeof *keys, teg_by_rate);
        return;
    }
    for (int k = 0; k < count; k++) sorted[(int)places[k]] = keys[k];
    memcpy(keys, sorted, (size_t)count * sizeof *keys);
}

//: teg_hull
/* Keep, of sorted keys, those that are least somewhere, from left to right; returns how many they are, 0 where there may be a tie. */
static int64_t teg_hull(teg_ray *keys, int64_t count)
{
    int64_t kept = 1;
    keys[0].from = 0.0;
    for (int64_t k = 1; k < count; k++) {
        teg_ray key = keys[k];
        key.from = 0.0;
        while (kept) {
            const teg_ray *const last = keys + kept - 1;
            const double steeper = last->rate - key.rate, above = key.at - last->at, size = fabs(key.at) + fabs(last->at);
            double margin;
            if (steeper == 0.0 && (above == 0.0 || above > TEG_BESIDE * size)) {
                key.from = 1.0; /* nowhere lower; of equal ones the first counts */
                break;
            }
            if (steeper == 0.0 && above >= -TEG_BESIDE * size) return 0;
            key.from = steeper == 0.0 ? -INFINITY : above / steeper;
            margin = TEG_BESIDE + (steeper == 0.0 ? 0.0 : 8.0 * TEG_KEY_ROUNDING * size / steeper);
            if (fabs(key.from - last->from) <= margin || fabs(key.from - 1.0) <= margin) return 0;
            if (key.from > last->from) break;
            key.from = 0.0, kept--;
        }
        if (key.from < 1.0) keys[kept++] = key;
    }
    return kept;
}

//: teg_measure_interval
/* Add what the keys that are least somewhere give to values, sizes and tables, each NULL if it is not wanted. */
static void teg_measure_interval(const teg_shape *s, int64_t n, const double *rows, const teg_ray *hull, int64_t count, double *values,
    double *sizes, double *tables)
{
    const int forms = teg_forms(s), numbers = teg_coefficients(s), columns = forms + numbers;
    for (int body = 0; body < s->bodies; body++) {
        double *const table = tables ? tables + body * (n + 1) * columns : NULL, value = 0.0, size = 0.0;
        for (int64_t k = 0; k < count; k++) {
            const teg_ray *const key = hull + k;
            const double from = key->from, to = k + 1 < count ? key[1].from : 1.0, length = to - from;
            const double *const f = rows + key->row * teg_wide(s) + forms + body * numbers;
            double power = 1.0, powers = 1.0;
            for (int j = 0, at = 0; j <= s->degree; at += ++j) { /* the mean of u^j is the sum of from^i * to^(j - i) over j + 1 */
                const double moment = length * powers / (j + 1);
                value += f[at] * moment, size += length * fabs(f[at]);
                if (tables) {
                    double *const own = table + key->row * columns + forms;
                    for (int i = 0, to_v = at; j + i <= s->degree; to_v += j + ++i + 1) own[to_v] = moment / (i + 1);
                }
                power *= from, powers = powers * to + power;
            }
            if (tables && k + 1 < count) {
                const double *const g = rows + key[1].row * teg_wide(s) + forms + body * numbers;
                double *const left = table + key->row * columns + forms - 3, *const right = table + key[1].row * columns + forms - 3;
                double jump = 0.0, at_end = 1.0;
                for (int j = 0, at = 0; j <= s->degree; at += ++j) jump += (g[at] - f[at]) * at_end, at_end *= to;
                jump /= key->rate - key[1].rate;
                left[0] += jump, left[1] += jump * to, left[2] += 0.5 * jump;
                right[0] -= jump, right[1] -= jump * to, right[2] -= 0.5 * jump;
            }
        }
        values[body] = value;
        if (sizes) sizes[body] = size;
    }
}

//: teg_envelope
/* Values, sizes (or NULL) and tables (or NULL) of n candidates, as `teg_cells` has them; returns whether they were computed. */
static int teg_envelope(const teg_shape *shape, int64_t n, const double *rows, double *values, double *sizes, double *tables)
{
    const teg_shape *const s = TEG_SHAPE(shape);
    teg_ray few[TEG_SOME], *const keys = n <= TEG_SOME ? few : malloc((size_t)n * sizeof *keys);
    int64_t count = keys ? teg_rays(s, n, rows, keys) : 0, kept = 0;
    if (count > TEG_FEW) count = teg_without_hidden(keys, count);
    if (count > 0) {
        teg_sort_by_rate(keys, count);
        kept = teg_hull(keys, count);
    }
    if (kept) {
        const size_t size = (size_t)s->bodies * (size_t)(n + 1) * (size_t)(teg_forms(s) + teg_coefficients(s));
        if (tables) memset(tables, 0, size * sizeof *tables);
        teg_measure_interval(s, n, rows, keys, kept, values, sizes, tables);
    }
    if (keys != few) free(keys);
    return kept > 0;
}
