/* Isolation of the roots of a function. */

//: teg_sign
/* The sign of g, as boxes know it: 1 if g > 0, 0 if not, 2 if g is NaN. */
static inline int teg_sign(double g)
{
    return isnan(g) ? 2 : g > 0.0;
}

//: teg_box
/* A box of an isolation: its ends, the signs of g there, and those of its slope. */
typedef struct {
    double from, to;
    int left, right, down, up, level;
} teg_box;

//: teg_changes
/* Whether g changes its sign in a box, and whether its slope does. */
static inline int teg_changes(const teg_box *box)
{
    return box->left + box->right == 1;
}

//: teg_turns
static inline int teg_turns(const teg_box *box)
{
    return box->down + box->up == 1;
}

//: teg_isolation
/* The isolation of the roots of g, a dialogue: it asks for g, g' and g" at `at`, and for a TEG_BOX or a TEG_TOUCH also for
   what is known over (from, to). Boxes are taken from left to right, so that few wait; `used` counts those of every level.
   `lost` are the undecided boxes that were met last, joined. */
typedef struct {
    enum { TEG_DONE, TEG_LEFT, TEG_RIGHT, TEG_BOX, TEG_STEP, TEG_TURN, TEG_TOUCH } asks;
    int count, steps, found, room, width, refused, crowded, missed, used[TEG_ISOLATE_DEPTH + 1];
    double at, from, to, before, last, limit, *roots, *errors;
    teg_box box, lost, second, waiting[TEG_ISOLATE_DEPTH + 2];
} teg_isolation;

//: teg_isolate
/* Begin with the signs at the ends; there is room for so many roots, and so many boxes on a level. */
static void teg_isolate(
    teg_isolation *s, double lo, double hi, double *roots, double *errors, int room, int width, double tol)
{
    const int finite = isfinite(lo) && isfinite(hi);
    s->roots = roots;
    s->errors = errors;
    s->room = room;
    s->width = width;
    s->limit = tol * fabs(hi - lo);
    s->count = s->found = s->crowded = s->missed = 0;
    s->refused = !finite;
    s->lost.level = s->second.level = -1;
    for (int i = 0; i <= TEG_ISOLATE_DEPTH; i++) s->used[i] = 0;
    s->box = (teg_box){lo < hi ? lo : hi, lo < hi ? hi : lo, 2, 2, 2, 2, 0};
    s->asks = finite && lo != hi ? TEG_LEFT : TEG_DONE;
    s->at = s->box.from;
}

//: teg_open_box
/* Ask for what is known over the next box. */
static inline void teg_open_box(teg_isolation *s)
{
    s->asks = TEG_BOX;
    s->from = s->box.from;
    s->to = s->box.to;
    s->at = 0.5 * (s->box.from + s->box.to);
}

//: teg_next_box
/* Take the leftmost box that waits, if there is one. */
static void teg_next_box(teg_isolation *s)
{
    s->asks = TEG_DONE;
    if (s->count == 0 || s->crowded) return;
    s->box = s->waiting[--s->count];
    teg_open_box(s);
}

//: teg_put_box
/* Let a box wait; too many boxes are as bad as too many roots. */
static inline void teg_put_box(teg_isolation *s, teg_box box)
{
    if (++s->used[box.level] > s->width) s->crowded = 1;
    else s->waiting[s->count++] = box;
}

//: teg_note_root
static inline void teg_note_root(teg_isolation *s, double root, double error)
{
    if (s->found == s->room) {
        s->crowded = 1;
        return;
    }
    s->missed |= error > s->limit;
    s->roots[s->found] = root;
    if (s->errors) s->errors[s->found] = error;
    s->found++;
}

//: teg_give_lost
/* The roots of the undecided boxes that were met last: one where g changes its sign, else two. */
static void teg_give_lost(teg_isolation *s)
{
    const teg_box lost = s->lost;
    if (lost.level < 0) return;
    s->lost.level = -1;
    const int times = teg_changes(&lost) ? 1 : lost.left != 2 && lost.right != 2 ? 2 : 0;
    for (int k = 0; k < times; k++) teg_note_root(s, 0.5 * (lost.from + lost.to), 0.5 * (lost.to - lost.from));
}

//: teg_found
static void teg_found(teg_isolation *s, double root, double error)
{
    teg_give_lost(s);
    teg_note_root(s, root, error);
}

//: teg_lose
/* Give up on a box; it is joined to its left neighbour, if that is undecided as well. */
static void teg_lose(teg_isolation *s)
{
    if (s->lost.level >= 0 && s->lost.to == s->box.from) {
        s->lost.to = s->box.to;
        s->lost.right = s->box.right;
    } else {
        teg_give_lost(s);
        s->lost = s->box;
    }
}

//: teg_halve
/* Halve a box at `at`, or leave it whole if there is no number inside. */
static void teg_halve(teg_isolation *s, double value, double slope)
{
    teg_box left = s->box, right = s->box;
    left.level = right.level = s->box.level + 1;
    if (s->at <= left.from || s->at >= left.to) {
        teg_put_box(s, left);
        return;
    }
    left.to = right.from = s->at;
    left.right = right.left = teg_sign(value);
    left.up = right.down = teg_sign(slope);
    teg_put_box(s, right);
    teg_put_box(s, left);
}

//: teg_is_monotone
/* Whether a box is monotone, by the bounds over it: none that hold a pole at which g changes its sign. */
static inline int teg_is_monotone(const teg_box *box, const double *bounds)
{
    const int pole = bounds[0] == -INFINITY && bounds[1] == INFINITY && (bounds[2] == -INFINITY || bounds[3] == INFINITY);
    return !pole && (bounds[2] > 0.0 || bounds[3] < 0.0) && box->left != 2 && box->right != 2;
}

//: teg_is_bent
/* Whether g is convex or concave over a box, by bounds that hold no pole. */
static inline int teg_is_bent(const teg_box *box, const double *bounds)
{
    const int known = box->left != 2 && box->right != 2 && box->down != 2 && box->up != 2;
    const int pole = (bounds[0] == -INFINITY || bounds[1] == INFINITY) && bounds[2] == -INFINITY && bounds[3] == INFINITY;
    return !pole && (bounds[4] > 0.0 || bounds[5] < 0.0) && known;
}

//: teg_is_clear
/* Whether a box has no root, by the bounds over it alone: g is constant, 0 everywhere, not 0, monotone, or bent without a turn
   towards 0. */
static inline int teg_is_clear(const teg_box *box, const double *bounds)
{
    if (bounds[2] == 0.0 && bounds[3] == 0.0) return 1;
    if (bounds[0] == 0.0 && bounds[1] == 0.0) return 1;
    if (teg_changes(box)) return 0;
    if (bounds[0] > 0.0 || bounds[1] < 0.0 || teg_is_monotone(box, bounds)) return 1;
    return teg_is_bent(box, bounds) && !(teg_turns(box) && box->left == (bounds[4] > 0.0));
}

//: teg_reach
/* How far g is from its value in the middle of a box, at most; infinity where its slope has no bounds. */
static inline double teg_reach(const teg_box *box, const double *bounds)
{
    const double left = fabs(bounds[2]), right = fabs(bounds[3]);
    return isfinite(left) && isfinite(right) ? 0.5 * (box->to - box->from) * (left > right ? left : right) : INFINITY;
}

//: teg_is_empty
/* Whether a box has no root, by its bounds, its noise and g in its middle: the mean value theorem, or g is not defined. */
static inline int teg_is_empty(const teg_box *box, double g, const double *bounds)
{
    if (teg_changes(box)) return 0;
    if (fabs(g) - teg_reach(box, bounds) > (isfinite(bounds[6]) ? bounds[6] : 0.0)) return 1;
    return isnan(bounds[0]) && isnan(bounds[1]) && isnan(g);
}

//: teg_is_blurred
/* Whether g cannot be told from 0 on a box: g, g', g" in its middle, then the bounds, then the noise. */
static inline int teg_is_blurred(const teg_box *box, const double *f)
{
    const double h = 0.5 * (box->to - box->from), down = fabs(f[7]), up = fabs(f[8]);
    const int blurred = fabs(f[0]) + h * fabs(f[1]) + 0.5 * h * h * (down > up ? down : up) <= f[9];
    return (blurred || (!teg_changes(box) && fabs(f[0]) + teg_reach(box, f + 3) <= f[9])) && isfinite(f[9]);
}

//: teg_step
/* A step of Newton's method for the zero of a function that is > 0 at the right end where `right` says so, kept in a box that
   shrinks around the zero. Returns whether another one is needed. */
static inline int teg_step(teg_isolation *s, double value, double slope, int right)
{
    const double v = s->at, step = -value / slope, newton = v + step;
    if (value == 0.0) return 0;
    *((value > 0.0) == right ? &s->box.to : &s->box.from) = v;
    const int within = newton >= s->box.from && newton <= s->box.to;
    const int good = within && step != 0.0 && !(fabs(step) > 0.5 * s->before);
    s->at = good ? newton : 0.5 * (s->box.from + s->box.to);
    s->before = s->last;
    s->last = fabs(good ? step : s->at - v);
    return s->last > 0x1p-52 * fabs(s->at) && ++s->steps < TEG_ISOLATE_STEPS;
}

//: teg_seek
/* Begin Newton's method in the middle of the box. */
static inline void teg_seek(teg_isolation *s, int asks)
{
    s->asks = asks;
    s->at = 0.5 * (s->box.from + s->box.to);
    s->steps = 0;
    s->before = s->last = INFINITY;
}

//: teg_approach
/* A step towards the root in the box, given g and g' at `at`; at its end the other root of a box that turned, or the next box. */
static void teg_approach(teg_isolation *s, const double *f)
{
    if (teg_step(s, f[0], f[1], s->box.right)) return;
    teg_found(s, s->at, 0.0);
    if (s->second.level < 0) {
        teg_next_box(s);
        return;
    }
    s->box = s->second;
    s->second.level = -1;
    teg_seek(s, TEG_STEP);
}

//: teg_near_turn
/* A step towards the place where g turns; at its end that is to be looked at. */
static void teg_near_turn(teg_isolation *s, const double *f)
{
    if (teg_step(s, f[1], f[2], s->box.up)) return;
    s->asks = TEG_TOUCH;
    s->from = s->to = s->at;
}

//: teg_judge_box
/* What becomes of a box whose bounds do not clear it, by what is known in its middle. */
static void teg_judge_box(teg_isolation *s, const double *f)
{
    const int monotone = teg_is_monotone(&s->box, f + 3), bent = teg_is_bent(&s->box, f + 3);
    if (teg_changes(&s->box) && (monotone || bent)) {
        teg_seek(s, TEG_STEP);
        teg_approach(s, f);
        return;
    }
    if (!teg_is_empty(&s->box, f[0], f + 3)) {
        if (bent) {
            s->second = s->box;
            teg_seek(s, TEG_TURN);
            teg_near_turn(s, f);
            return;
        }
        if (s->box.level == TEG_ISOLATE_DEPTH || teg_is_blurred(&s->box, f)) teg_lose(s);
        else teg_halve(s, f[0], f[1]);
    }
    teg_next_box(s);
}

//: teg_judge_turn
/* What becomes of a box that turns at `at`, of which all is known there: two roots, one twice, or none. */
static void teg_judge_turn(teg_isolation *s, const double *f)
{
    s->box = s->second;
    s->second.level = -1;
    if (fabs(f[0]) <= f[9] && isfinite(f[9])) {
        for (int k = 0; k < 2; k++) teg_found(s, s->at, sqrt(2.0 * f[9] / fabs(f[2])));
    } else if ((f[0] > 0.0) != s->box.left) {
        s->second = s->box;
        s->box.to = s->second.from = s->at;
        s->box.right = s->second.left = f[0] > 0.0;
        teg_seek(s, TEG_STEP);
        return;
    }
    teg_next_box(s);
}

//: teg_answer
/* Take what was asked for (g, g', g", and of a TEG_BOX or a TEG_TOUCH the bounds g-, g+, d-, d+, c-, c+ and the noise), and
   ask for what is needed next. */
static void teg_answer(teg_isolation *s, const double *f)
{
    switch (s->asks) {
    case TEG_LEFT:
        s->box.left = teg_sign(f[0]);
        s->box.down = teg_sign(f[1]);
        s->asks = TEG_RIGHT;
        s->at = s->box.to;
        return;
    case TEG_RIGHT:
        s->box.right = teg_sign(f[0]);
        s->box.up = teg_sign(f[1]);
        teg_open_box(s);
        return;
    case TEG_BOX:
        teg_judge_box(s, f);
        return;
    case TEG_TURN:
        teg_near_turn(s, f);
        return;
    case TEG_TOUCH:
        teg_judge_turn(s, f);
        return;
    default:
        teg_approach(s, f);
    }
}

//: teg_roots
/* The roots in order, then +inf, and their errors; NaN if there are more than fit. */
static void teg_roots(teg_isolation *s, teg_context *ctx)
{
    if (!s->refused && !s->crowded) teg_give_lost(s);
    if (s->refused || s->crowded) {
        ctx->crowded |= s->crowded;
        teg_fill(s->roots, s->room, NAN);
        if (s->errors) teg_fill(s->errors, s->room, NAN);
        return;
    }
    ctx->missed |= s->missed;
    teg_fill(s->roots + s->found, s->room - s->found, INFINITY);
    if (s->errors) teg_fill(s->errors + s->found, s->room - s->found, 0.0);
}
