/* Location of the common zeros of two functions. */

//: teg_location
/* The location of common zeros of f and g, a dialogue: it asks for their bounds over `here`, a TEG_RECTANGLE of this level or a
   point. The rectangles that are left of a level, by their corners in parts of the whole, and those of the next one take turns in
   `across` and `up`; `zeros` are those known to be alone in a rectangle. */
typedef struct {
    enum { TEG_RECTANGLE, TEG_MIDDLE, TEG_NEWTON } asks;
    int slopes, level, number, taken, left, examined, found, steps, times[2], last, useless[2], useful[2];
    double lo, low, extent, height, wide, tall, v, u, half, rise, bounds[8];
    struct {
        double left, right, bottom, top;
    } here;
    double across[2][TEG_LOCATE_WIDTH], up[2][TEG_LOCATE_WIDTH], zeros[TEG_LOCATE_ZEROS];
} teg_location;

//: teg_locate
/* Begin with the whole rectangle, if there is one; are the slopes bounded too? */
static void teg_locate(teg_location *s, int slopes, double lo, double hi, double low, double high)
{
    const int finite = isfinite(lo) && isfinite(hi) && isfinite(low) && isfinite(high);
    s->asks = TEG_RECTANGLE;
    s->slopes = slopes;
    s->lo = lo < hi ? lo : hi;
    s->low = low < high ? low : high;
    s->extent = fabs(hi - lo);
    s->height = fabs(high - low);
    s->wide = s->tall = 1.0;
    s->half = s->rise = 0.0;
    s->level = s->taken = s->left = s->found = s->steps = 0;
    s->times[0] = s->times[1] = s->useless[0] = s->useless[1] = s->useful[0] = s->useful[1] = 0;
    s->last = -1;
    s->examined = s->number = finite && lo != hi && low != high;
}

//: teg_corner
/* The corner of a rectangle of this level: one half of what was left of the level before. */
static inline void teg_corner(teg_location *s, int i)
{
    const int before = (s->level - 1) & 1;
    s->v = s->u = 0.0;
    if (s->level == 0) return;
    s->v = s->across[before][i / 2];
    s->u = s->up[before][i / 2];
    if (i % 2 == 0) return;
    if (s->last == 0) s->v += s->wide;
    else s->u += s->tall;
}

//: teg_direction
/* In which direction the rectangles that are left are halved, 0 for v and 1 for u: by turns, but in one again that is of use
   while the other is not. */
static inline int teg_direction(teg_location *s)
{
    if (s->last >= 0) {
        s->useless[s->last] = 50 * s->left >= 49 * s->number;
        s->useful[s->last] = 20 * s->left <= 11 * s->number;
    }
    int along = s->times[0] > s->times[1];
    if (s->useless[1] && s->useful[0]) along = 0;
    else if (s->useless[0] && s->useful[1]) along = 1;
    return s->times[along] < TEG_LOCATE_HALVINGS ? along : 1 - along;
}

//: teg_next_level
/* A level was examined: is there to be another one? */
static inline int teg_next_level(teg_location *s)
{
    const int twice = 2 * s->left, finest = s->times[0] == TEG_LOCATE_HALVINGS && s->times[1] == TEG_LOCATE_HALVINGS;
    if (twice == 0 || twice > TEG_LOCATE_WIDTH || s->examined + twice > TEG_LOCATE_MOST || finest) return 0;
    if (s->found > TEG_LOCATE_ZEROS) return 0;
    s->last = teg_direction(s);
    s->times[s->last]++;
    s->level++;
    s->number = twice;
    s->examined += twice;
    s->taken = s->left = 0;
    if (s->last == 0) s->wide *= 0.5;
    else s->tall *= 0.5;
    return 1;
}

//: teg_next_rectangle
/* Take the next rectangle. Returns whether there is anything to be asked. */
static inline int teg_next_rectangle(teg_location *s)
{
    if (s->asks != TEG_RECTANGLE) return 1;
    if (s->taken == s->number && !teg_next_level(s)) return 0;
    teg_corner(s, s->taken);
    s->here.left = s->lo + s->extent * s->v;
    s->here.right = s->lo + s->extent * (s->v + s->wide);
    s->here.bottom = s->low + s->height * s->u;
    s->here.top = s->low + s->height * (s->u + s->tall);
    return 1;
}

//: teg_ask_at
/* Ask for the values at a point. */
static inline void teg_ask_at(teg_location *s, double v, double u)
{
    s->here.left = s->here.right = v;
    s->here.bottom = s->here.top = u;
}

//: teg_excluded
/* Whether bounds f-, f+, g-, g+ leave no common zero. */
static inline int teg_excluded(const double *f)
{
    return f[0] > 0.0 || f[1] < 0.0 || f[2] > 0.0 || f[3] < 0.0 || (isnan(f[0]) && isnan(f[1])) || (isnan(f[2]) && isnan(f[3]));
}

//: teg_krawczyk
/* What bounds of slopes over a rectangle with half the sides h and k, and the values f and g in its middle, say of common zeros:
   -1, there is none; 1, there is one, and Newton's method finds it; 0, nothing. */
static int teg_krawczyk(const double *bounds, double f, double g, double h, double k)
{
    double size[4], middle[4], radius[4];
    for (int i = 0; i < 4; i++) {
        const double least = bounds[2 * i], most = bounds[2 * i + 1];
        size[i] = fmax(fabs(least), fabs(most));
        if (isnan(least) || isnan(most)) size[i] = NAN;
        middle[i] = 0.5 * (least + most);
        radius[i] = 0.5 * (most - least);
    }
    if (fabs(f) > size[0] * h + size[1] * k || fabs(g) > size[2] * h + size[3] * k) return -1;
    const double det = fabs(middle[0] * middle[3] - middle[1] * middle[2]);
    const double a = middle[0] / det, b = middle[1] / det, c = middle[2] / det, d = middle[3] / det;
    const double v = fabs(d * f - b * g), u = fabs(a * g - c * f);
    const double across = (fabs(d) * radius[0] + fabs(b) * radius[2]) * h + (fabs(d) * radius[1] + fabs(b) * radius[3]) * k;
    const double up = (fabs(c) * radius[0] + fabs(a) * radius[2]) * h + (fabs(c) * radius[1] + fabs(a) * radius[3]) * k;
    if (v > h + across || u > k + up) return -1;
    return across <= 0.25 * h && up <= 0.25 * k && v + across < h && u + up < k;
}

//: teg_done
/* The rectangle that was asked for is done with; it may be left over. */
static inline void teg_done(teg_location *s, int left)
{
    if (left) {
        s->across[s->level & 1][s->left] = s->v;
        s->up[s->level & 1][s->left++] = s->u;
    }
    s->taken++;
    s->asks = TEG_RECTANGLE;
}

//: teg_newton
/* A step of Newton's method from `here`, by f, g and their slopes there. */
static inline void teg_newton(teg_location *s, const double *f)
{
    const double det = f[4] * f[10] - f[6] * f[8];
    const double v = s->here.left - (f[10] * f[0] - f[6] * f[2]) / det, u = s->here.bottom - (f[4] * f[2] - f[8] * f[0]) / det;
    if (++s->steps < TEG_LOCATE_STEPS) {
        teg_ask_at(s, v, u);
        return;
    }
    if (s->found < TEG_LOCATE_ZEROS) s->zeros[s->found] = v;
    s->found++;
    teg_done(s, 0);
}

//: teg_judge
/* Drop, keep or settle a rectangle, by the bounds of f, of g and of their slopes over `here`. */
static inline void teg_judge(teg_location *s, const double *f)
{
    const double h = 0.5 * (s->here.right - s->here.left), k = 0.5 * (s->here.top - s->here.bottom);
    if (s->asks == TEG_RECTANGLE && (teg_excluded(f) || !s->slopes)) {
        teg_done(s, !teg_excluded(f));
    } else if (s->asks == TEG_RECTANGLE) {
        for (int i = 0; i < 8; i++) s->bounds[i] = f[4 + i];
        s->half = h;
        s->rise = k;
        s->asks = TEG_MIDDLE;
        teg_ask_at(s, 0.5 * (s->here.left + s->here.right), 0.5 * (s->here.bottom + s->here.top));
    } else if (s->asks == TEG_MIDDLE) {
        const int known = teg_krawczyk(s->bounds, f[0], f[2], s->half, s->rise);
        if (known != 1) {
            teg_done(s, known == 0);
            return;
        }
        s->asks = TEG_NEWTON;
        s->steps = 0;
        teg_newton(s, f);
    } else {
        teg_newton(s, f);
    }
}

//: teg_put_place
/* Put a place behind the others, if there is room. */
static inline int teg_put_place(double *places, int room, int found, double place)
{
    if (found < room) places[found] = place;
    return found + 1;
}

//: teg_places
/* The places of the zeros and of the rectangles left over, in order, then +inf: of intervals that overlap or touch the middle,
   or both ends if that is wide. Returns the part of the whole in which there may be others. */
static double teg_places(teg_location *s, double *places, int room)
{
    const int left = s->left;
    const double same = TEG_LOCATE_SAME * s->extent;
    double *const across = s->across[s->level & 1], lost = 0.0, from = 0.0, to = 0.0;
    int found = 0, open = 0, inside = 0;
    if (s->found > TEG_LOCATE_ZEROS) {
        teg_fill(places, room, INFINITY);
        return 1.0;
    }
    teg_sort(s->zeros, s->found);
    teg_sort(across, left);
    for (int i = 0, k = 0; i < s->found || k < left || open;) {
        const double zero = i < s->found ? s->zeros[i] - same : INFINITY;
        const double other = k < left ? s->lo + s->extent * across[k] : INFINITY;
        const int next = other < zero, any = next || i < s->found;
        const double begin = next ? other : zero;
        const double end = next ? s->lo + s->extent * (across[k] + s->wide) : any ? s->zeros[i] + same : INFINITY;
        if (next) k++;
        else i++;
        if (open && begin <= to) {
            if (end > to) to = end;
            inside += next;
            continue;
        }
        if (open && to - from > TEG_LOCATE_NARROW * s->extent) {
            found = teg_put_place(places, room, found, from);
            found = teg_put_place(places, room, found, to);
            lost += inside;
        } else if (open) {
            found = teg_put_place(places, room, found, 0.5 * (from + to));
        }
        open = any;
        inside = next;
        from = begin;
        to = end;
    }
    lost *= s->wide * s->tall;
    if (found > room) {
        const double behind = (s->lo + s->extent - places[room - 1]) / s->extent;
        return behind > 0.0 ? fmin(1.0, lost + behind) : lost;
    }
    teg_fill(places + found, room - found, INFINITY);
    return lost;
}
