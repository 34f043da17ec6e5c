/* Candidates over one another that end at one side of the square, as teg.numerics.side_lines has them. */

//: teg_side_line
/* A guard whose line is on a side of the square: twice the side, + 1 if its region is beyond it; the part of the side where the other guards
   hold; the key in the middle. Guards of one colour are moved together. */
typedef struct {
    double first, last, key;
    int64_t region;
    int column, side;
    size_t colour;
} teg_side_line;

//: teg_side_ends
/* The ends of each side, among the corners (0, 0), (1, 0), (0, 1), (1, 1). */
static const int teg_side_ends[4][2] = {{0, 2}, {1, 3}, {0, 1}, {2, 3}};

//: teg_side_of
/* The side of the square that the line of a form lies on, twice, + 1 if the form is negative in the square; or -1. */
static int teg_side_of(const double *g)
{
    const double at[4] = {g[0], g[0] + g[1], g[0] + g[2], g[0] + g[1] + g[2]};
    const double size = sqrt(g[1] * g[1] + g[2] * g[2]), near = TEG_ON_LINE * size;
    for (int side = 0; side < 4 && size > 0.0 && size < INFINITY; side++)
        if (fabs(at[teg_side_ends[side][0]]) <= near && fabs(at[teg_side_ends[side][1]]) <= near)
            return 2 * side + (g[0] + 0.5 * (g[1] + g[2]) < 0.0);
    return -1;
}

//: teg_part_of_side
/* The part of a side on which guards hold that have not their lines there. */
static void teg_part_of_side(const double *guards, int count, teg_side_line *line)
{
    line->first = 0.0, line->last = 1.0;
    for (const double *g = guards; g < guards + 3 * count; g += 3) {
        const double at[4] = {g[0], g[0] + g[1], g[0] + g[2], g[0] + g[1] + g[2]};
        const double d = at[teg_side_ends[line->side / 2][0]], e = at[teg_side_ends[line->side / 2][1]];
        if (teg_side_of(g) == line->side) continue;
        if (d < 0.0 && e < 0.0) line->last = -1.0;
        else if (d < 0.0) line->first = fmax(line->first, d / (d - e));
        else if (e < 0.0) line->last = fmin(line->last, d / (d - e));
    }
}

//: teg_by_key
static int teg_by_key(const void *a, const void *b)
{
    const teg_side_line *const p = a, *const q = b;
    if (p->key != q->key) return p->key < q->key ? -1 : 1;
    return p->region < q->region ? -1 : p->region > q->region ? 1 : p->column - q->column;
}

//: teg_find_side_lines
/* Find the lines on sides of the square, nearest first; returns how many. There is no array where there is at most one. */
static size_t teg_find_side_lines(teg_arrangement *r, teg_side_line **found)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    size_t count = 0, all;
    for (int64_t k = 0; k < r->n * s->parts; k++)
        for (int j = 0; j < s->guards; j++)
            count += teg_side_of(r->rows + k / s->parts * teg_row(s) + 3 * ((int)(k % s->parts) * s->guards + j)) >= 0;
    if (count < 2) return count;
    *found = malloc(count * sizeof **found);
    if (!*found) {
        r->failed = 1;
        return 0;
    }
    all = 0;
    for (int64_t k = 0; k < r->n * s->parts; k++) {
        const double *const row = r->rows + k / s->parts * teg_row(s), *const key = row + teg_forms(s) - 3;
        const int first = 3 * (int)(k % s->parts) * s->guards;
        for (int j = 0; j < s->guards; j++) {
            const int side = teg_side_of(row + first + 3 * j);
            teg_side_line *const line = *found + all;
            if (side < 0) continue;
            line->region = k, line->side = side, line->column = first + 3 * j, line->key = key[0] + 0.5 * key[1] + 0.5 * key[2];
            teg_part_of_side(row + first, s->guards, line);
            all += line->last - line->first > TEG_BESIDE;
        }
    }
    qsort(*found, all, sizeof **found, teg_by_key);
    return all;
}

//: teg_colour
/* Give lines colours, different ones to those that overlap on one side; returns how many colours there are. */
static size_t teg_colour(teg_arrangement *r, teg_side_line *lines, size_t count)
{
    size_t colours = 1;
    unsigned char *const taken = malloc(count + 1);
    if (!taken) r->failed = 1;
    for (size_t k = 0; k < count && taken; k++) {
        size_t same = count;
        memset(taken, 0, count + 1);
        for (size_t j = 0; j < k; j++) {
            const double common = teg_least_of(lines[j].last, lines[k].last) - teg_most_of(lines[j].first, lines[k].first);
            if (lines[j].side != lines[k].side) continue;
            if (lines[j].region == lines[k].region) same = lines[j].colour;
            else if (common > TEG_BESIDE) taken[lines[j].colour] = 1;
        }
        lines[k].colour = 0;
        while (taken[lines[k].colour]) lines[k].colour++;
        if (same < count) lines[k].colour = same;
        if (lines[k].colour + 1 > colours) colours = lines[k].colour + 1;
    }
    free(taken);
    return colours;
}

//: teg_displace
/* Put lines of one colour, counted from 1, inside of the square, which is moved by (su, sv), and the others outside; `rows` are the candidates, `moved` a
   copy. */
static void teg_displace(
    const teg_arrangement *r, const teg_side_line *lines, size_t count, size_t colour, const double *rows, double *moved)
{
    const teg_shape *const s = TEG_SHAPE(r->shape);
    for (size_t k = 0; k < count; k++) {
        const int64_t at = lines[k].region / s->parts * teg_row(s) + lines[k].column;
        const double step = rows[at + 1] * r->su + rows[at + 2] * r->sv;
        const int shrinks = (lines[k].colour + 1 == colour) != (lines[k].side & 1);
        moved[at] = rows[at] - step - (shrinks ? fabs(step) : -fabs(step));
    }
}
