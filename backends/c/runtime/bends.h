/* Substitutions around singularities, tails and poles. */

//: teg_substitution
/* Where u in (0, 1) is on a piece (p, q), and how fast it goes: centre + radius*phi(start + step*u), phi by kind. */
typedef struct {
    enum { TEG_LINE, TEG_CUBIC, TEG_SQUARE, TEG_SINE, TEG_COSH, TEG_SINH, TEG_EXP, TEG_POWER, TEG_TAIL, TEG_SLOW_TAIL } kind;
    int at_p, at_q, both, number;
    double p, q, centre, radius, start, step, nearest;
} teg_substitution;

//: teg_straight
/* The straight one, or the one with flat ends. */
static inline void teg_straight(teg_substitution *s, double p, double q, int cubic)
{
    s->kind = cubic ? TEG_CUBIC : TEG_LINE;
    s->at_p = s->at_q = -1;
    s->both = s->number = 0;
    s->p = s->centre = p;
    s->q = q;
    s->radius = q - p;
    s->start = 0.0;
    s->step = 1.0;
    s->nearest = TEG_NEAR;
}

//: teg_tail
/* A tail, if the piece is one. */
static inline void teg_tail(teg_substitution *s, double scale)
{
    if (isfinite(s->q - s->p)) return;
    const int left = isinf(s->p);
    s->kind = TEG_TAIL;
    s->centre = left ? s->q : s->p;
    s->radius = left ? -scale : scale;
    s->start = left ? 1.0 : 0.0;
    s->step = left ? -1.0 : 1.0;
}

//: teg_slow_tail
/* A tail on which values fall off like a power, if the piece is one. */
static inline void teg_slow_tail(teg_substitution *s, double scale, double reach)
{
    teg_tail(s, scale);
    if (s->kind != TEG_TAIL) return;
    s->kind = TEG_SLOW_TAIL;
    s->start *= reach;
    s->step *= reach;
}

//: teg_inside
/* Where on a piece its conditions are decided. */
static inline double teg_inside(double p, double q, double scale)
{
    if (isinf(p)) return q - scale * ((1.0 - TEG_INSIDE) / TEG_INSIDE);
    return isinf(q) ? p + scale * (TEG_INSIDE / (1.0 - TEG_INSIDE)) : p + TEG_INSIDE * (q - p);
}

//: teg_nearness
/* The sum of the distances of y from the foci of the ellipses around (p, q), scaled to (-1, 1). */
static inline double teg_nearness(double y, double p, double q)
{
    return (fabs(y - p) + fabs(y - q)) * (2.0 / (q - p));
}

//: teg_bend
/* The zeros of c0 + c1*w + c2*w*w, w from the base, as a bend of a kind ('r'oot, 'p'ole, 'e'nd): if it is nearer than what was
   found before, it gives the substitution. */
static void teg_bend(teg_substitution *s, int kind, int when, double base, double c0, double c1, double c2)
{
    const int number = s->number++;
    const double p = s->p - base, q = s->q - base, length = q - p, width = fabs(p) > fabs(q) ? fabs(p) : fabs(q);
    const int linear = fabs(c2) * width * width <= 1e-13 * (fabs(c1) * width + fabs(c0));
    if (!when || !isfinite(c0) || !isfinite(c1) || !isfinite(c2) || !isfinite(length)) return;
    if (linear && fabs(c1) * width <= 1e-13 * fabs(c0)) return;
    const double square = c1 * c1 - 4.0 * c0 * c2, larger = -0.5 * (c1 + copysign(sqrt(fabs(square)), c1));
    const double end = TEG_AT_END * length;
    const int paired = !linear && square < 0.0;
    double one = linear ? -c0 / c1 : c0 / larger, other = linear ? one : larger / c2;
    const double to_one = teg_nearness(one, p, q), to_other = teg_nearness(other, p, q);
    const int alone = !paired && (linear || to_one > TEG_FAR || to_other > TEG_FAR || !isfinite(to_one + to_other));
    if (alone && !(to_one <= to_other)) one = other;
    if (alone) other = one;
    const double below = one < other ? one : other, above = one < other ? other : one;
    double m = paired ? -0.5 * c1 / c2 : 0.5 * (below + above);
    double h = paired ? sqrt(fabs(square)) * fabs(0.5 / c2) : 0.5 * (above - below);
    if (!alone && !(h >= (paired ? 1e-100 : 1e-12) * length)) return;
    const double to_below = teg_nearness(below, p, q), to_above = teg_nearness(above, p, q);
    const double near = paired ? (hypot(m - p, h) + hypot(m - q, h)) * (2.0 / length) : to_below < to_above ? to_below : to_above;
    const int at_p = !paired && (fabs(below - p) <= end || fabs(above - p) <= end);
    const int at_q = !paired && (fabs(below - q) <= end || fabs(above - q) <= end);
    if (kind == 'p') {
        const double y = to_below <= to_above ? below : above;
        const double margin = TEG_POLE * (fabs(s->p) > fabs(s->q) ? fabs(s->p) : fabs(s->q));
        if (!paired && !(y < p - margin || y > q + margin)) return;
    } else if (!paired && ((below > p + end && below < q - end) || (above > p + end && above < q - end))) {
        return; /* the substitution would leave out what is beyond a zero */
    } else if (at_p != at_q) {
        if (at_p ? s->at_q >= 0 : s->at_p >= 0) s->both = 1;
        if (at_p) s->at_p = number;
        if (at_q) s->at_q = number;
    }
    if (!(near < s->nearest)) return;
    s->nearest = near;
    const double centre = 0.5 * (p + q);
    const double at_left = fabs(above - p) <= end ? above : below, at_right = fabs(below - q) <= end ? below : above;
    const double left = at_p ? fmin(0.0, p - at_left) : 0.0; /* zeros at the ends do not stay inside */
    const double right = at_q ? fmax(0.0, q - at_right) : 0.0;
    double sign = m <= centre ? 1.0 : -1.0, from, to;
    if (paired) {
        s->kind = TEG_SINH;
        sign = 1.0;
        from = asinh((p - m) / h);
        to = asinh((q - m) / h);
    } else if (kind == 'p') {
        s->kind = TEG_EXP;
        m = to_below <= to_above ? below : above;
        sign = m <= centre ? 1.0 : -1.0;
        h = 1.0;
        from = log(sign * (p - m));
        to = log(sign * (q - m));
    } else if (kind == 'e' && at_p != at_q) {
        s->kind = TEG_POWER;
        m = at_p ? p : q;
        sign = at_p ? 1.0 : -1.0;
        h = length;
        from = at_p ? 0.0 : 1.0;
        to = at_p ? 1.0 : 0.0;
    } else if (alone) {
        s->kind = TEG_SQUARE;
        m += left + right;
        h = 1.0;
        from = sqrt(fmax(0.0, sign * (p - m)));
        to = sqrt(fmax(0.0, sign * (q - m)));
    } else if (fabs(centre - m) <= h) {
        s->kind = TEG_SINE;
        m += 0.5 * (left + right);
        h += 0.5 * (right - left);
        sign = 1.0;
        from = asin(fmax(-1.0, fmin(1.0, (p - m) / h)));
        to = asin(fmax(-1.0, fmin(1.0, (q - m) / h)));
    } else {
        s->kind = TEG_COSH;
        m += left + right;
        from = acosh(fmax(1.0, sign * (p - m) / h));
        to = acosh(fmax(1.0, sign * (q - m) / h));
    }
    s->centre = base + m;
    s->radius = sign * h;
    s->start = from;
    s->step = to - from;
}

//: teg_bent
/* Two bends at the two ends: flat ends. */
static inline void teg_bent(teg_substitution *s)
{
    if (s->both) teg_straight(s, s->p, s->q, 1);
}

//: teg_pole
/* A pole D = 0 and a piece, at whose ends D is `low` and `high`: it counts there or not, and is clear of the piece or met on it.
   `size` is how large the terms of D are. */
typedef struct {
    enum { TEG_NONE, TEG_CLEAR, TEG_MET } kind;
    double low, high, least, size;
} teg_pole;

//: teg_pole_at
static inline teg_pole teg_pole_at(int when, double p, double q, double base, double c0, double c1)
{
    const double first = p - base, last = q - base, low = c0 + c1 * first, high = c0 + c1 * last;
    const double least = fabs(low) < fabs(high) ? fabs(low) : fabs(high), left = fabs(p), right = fabs(q);
    const double size = fabs(c0) + fabs(c1) * (fabs(first) > fabs(last) ? fabs(first) : fabs(last));
    teg_pole pole = {TEG_NONE, low, high, least, size};
    if (!when || !isfinite(c0) || !isfinite(c1)) return pole;
    pole.kind = low * high > 0.0 && least > TEG_POLE * (left > right ? left : right) * fabs(c1) ? TEG_CLEAR : TEG_MET;
    return pole;
}

//: teg_pole_loss
/* What is lost of an integral over the power of D, relative to that of |values|. */
static inline double teg_pole_loss(int power, const teg_pole *pole)
{
    return pole->kind == TEG_CLEAR ? power * TEG_EDGE * pole->size / pole->least : 0.0;
}

//: teg_meet
/* Add the values at a node to three sums each: plain, by the first null rule, and of the sizes. */
static inline void teg_meet(int n, const double *f, double weight, double null, double *sizes)
{
    for (int j = 0; j < n; j++) {
        sizes[3 * j] += weight * f[j];
        sizes[3 * j + 1] += null * f[j];
        sizes[3 * j + 2] += weight * fabs(f[j]);
    }
}

//: teg_is_endless
/* Values that have a pole on the piece become infinite; whether there are any. */
static inline int teg_is_endless(int n, const double *sizes, double *sum)
{
    int found = 0;
    for (int j = 0; j < n; j++) {
        if (!(fabs(sizes[3 * j + 1]) > TEG_RESIDUE * sizes[3 * j + 2])) continue;
        sum[j] += copysign(INFINITY, sizes[3 * j]);
        found = 1;
    }
    return found;
}

//: teg_beside
/* The next normal number to p towards q. */
static double teg_beside(double p, double q)
{
    const double after = nextafter(p, q);
    return fabs(after) < DBL_MIN ? copysign(DBL_MIN, q - p) : after;
}

//: teg_within
/* A place that is kept inside of (p, q). */
static inline double teg_within(double p, double q, double place)
{
    if (!(place > p)) return teg_beside(p, q);
    return place < q ? place : teg_beside(q, p);
}

//: teg_place
/* The place of u; dv/du is written to `slope`. */
static double teg_place(const teg_substitution *s, double u, double *slope)
{
    const double t = s->start + s->step * u;
    double place, rate;
    switch (s->kind) {
    case TEG_CUBIC: place = t * t * (3.0 - 2.0 * t); rate = 6.0 * t * (1.0 - t); break;
    case TEG_SQUARE: place = t * t; rate = 2.0 * t; break;
    case TEG_SINE: place = sin(t); rate = cos(t); break;
    case TEG_COSH: place = cosh(t); rate = sinh(t); break;
    case TEG_SINH: place = sinh(t); rate = cosh(t); break;
    case TEG_EXP: place = rate = exp(t); break;
    case TEG_POWER: place = t * t * t * t * t * t; rate = 6.0 * (t * t * t * t * t); break;
    case TEG_TAIL: place = t / (1.0 - t); rate = 1.0 / ((1.0 - t) * (1.0 - t)); break;
    case TEG_SLOW_TAIL: {
        const double reach = fabs(s->step), left = fmax(1.0 - t / reach, 0x1p-53);
        const double exponent = fmin(t / TEG_AT_REACH / left, reach), last = 1.0 / (1.0 + TEG_AT_REACH);
        place = sinh(exponent);
        rate = cosh(exponent) / (TEG_AT_REACH * left * (left > last ? left : TEG_BEYOND * last));
        break;
    }
    default: place = t; rate = 1.0; break;
    }
    *slope = s->radius * s->step * rate;
    return teg_within(s->p, s->q, s->centre + s->radius * place);
}
