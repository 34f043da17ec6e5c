/* Value and gradient of some scenes of `teg chart lean` by hand: the least that is known to take. Columns in, columns out:
   p[k][i] is parameter k of element i, out[0][i] its value and out[1 + k][i] the derivative by parameter k. Each formula holds for the
   elements of its scene only. */

#include <math.h>
#include <string.h>

#define SCENE(name) void name(long n, const double *const *p, double *const *out)

static double ramp(double u) { return u > 0.0 ? u : 0.0; }
static double parabola(double u) { return u > 0.0 ? 0.5 * u * u : 0.0; }

/* The area of x + a*y < t in the unit square, a > 0: a second difference of u*u/2. */
SCENE(half_plane)
{
    const double *t = p[0], *a = p[1];
#pragma GCC ivdep
    for (long i = 0; i < n; i++) {
        const double u = t[i], c = a[i], inverse = 1.0 / c;
        const double area = (parabola(u) - parabola(u - 1.0) - parabola(u - c) + parabola(u - 1.0 - c)) * inverse;
        out[0][i] = area;
        out[1][i] = (ramp(u) - ramp(u - 1.0) - ramp(u - c) + ramp(u - 1.0 - c)) * inverse;
        out[2][i] = (ramp(u - c) - ramp(u - 1.0 - c) - area) * inverse;
    }
}

/* A triangle of one colour beside its pixel or all over it, counterclockwise: x0 y0 x1 y1 x2 y2, three colours, pixel (left, bottom), three
   targets. */
SCENE(flat_triangle)
{
    const double *x0 = p[0], *y0 = p[1], *x1 = p[2], *y1 = p[3], *x2 = p[4], *y2 = p[5], *left = p[9], *bottom = p[10];
    const double *red = p[6], *green = p[7], *blue = p[8], *wanted_red = p[11], *wanted_green = p[12], *wanted_blue = p[13];
    double *loss = out[0], *by_red = out[7], *by_green = out[8], *by_blue = out[9];
#pragma GCC ivdep
    for (long i = 0; i < n; i++) {
        const double x = left[i] + 0.5, y = bottom[i] + 0.5;
        const double first = (x1[i] - x0[i]) * (y - y0[i]) - (y1[i] - y0[i]) * (x - x0[i]);
        const double second = (x2[i] - x1[i]) * (y - y1[i]) - (y2[i] - y1[i]) * (x - x1[i]);
        const double third = (x0[i] - x2[i]) * (y - y2[i]) - (y0[i] - y2[i]) * (x - x2[i]);
        const double inside = (first > 0.0) & (second > 0.0) & (third > 0.0) ? 1.0 : 0.0;
        const double r = red[i] - wanted_red[i], g = green[i] - wanted_green[i], b = blue[i] - wanted_blue[i];
        loss[i] = inside * (r * r + g * g + b * b);
        by_red[i] = 2.0 * inside * r;
        by_green[i] = 2.0 * inside * g;
        by_blue[i] = 2.0 * inside * b;
    }
    for (int k = 1; k < 7; k++)
        memset(out[k], 0, (size_t)n * sizeof(double));
}

/* The area of a disk (square of the radius, centre) in the unit square, its centre inside, no corner of the square in it. */
SCENE(disk)
{
    for (long i = 0; i < n; i++) {
        const double square = p[0][i], radius = sqrt(square), pi = 3.14159265358979323846;
        const double away[4] = {p[1][i], 1.0 - p[1][i], p[2][i], 1.0 - p[2][i]};
        double area = pi * square, angle = 2.0 * pi, chord[4];
        for (int k = 0; k < 4; k++) {
            chord[k] = 0.0;
            if (away[k] < radius) {
                const double half = acos(away[k] / radius);
                chord[k] = sqrt(square - away[k] * away[k]);
                area -= square * half - away[k] * chord[k];
                angle -= 2.0 * half;
            }
        }
        out[0][i] = area;
        out[1][i] = 0.5 * angle;
        out[2][i] = 2.0 * (chord[0] - chord[1]);
        out[3][i] = 2.0 * (chord[2] - chord[3]);
    }
}

/* The integral of exp(a*x) from 0 to t. */
SCENE(bracket_exp)
{
    const double *t = p[0], *a = p[1];
    for (long i = 0; i < n; i++) {
        const double less = expm1(a[i] * t[i]), value = less / a[i];
        out[0][i] = value;
        out[1][i] = less + 1.0;
        out[2][i] = (t[i] * (less + 1.0) - value) / a[i];
    }
}

/* The mean of max(exp(s*x + m) - k, 0) for a standard normal x. */
SCENE(payoff)
{
    const double *s = p[0], *m = p[1], *k = p[2];
    for (long i = 0; i < n; i++) {
        const double place = (m[i] - log(k[i])) / s[i], root = 0.70710678118654752440;
        const double grown = exp(m[i] + 0.5 * s[i] * s[i]), ahead = place + s[i];
        const double above = 0.5 * erfc(-root * ahead), below = 0.5 * erfc(-root * place);
        const double density = 0.39894228040143267794 * exp(-0.5 * ahead * ahead);
        out[0][i] = grown * above - k[i] * below;
        out[1][i] = grown * (s[i] * above + density);
        out[2][i] = grown * above;
        out[3][i] = -below;
    }
}

/* Fifty brackets [x < t] with heights c, times exp(a*x), over (0, 1): t0 to t49, c0 to c49, a; all t inside. */
SCENE(brackets)
{
    enum { COUNT = 50 };
    for (long i = 0; i < n; i++) {
        const double a = p[2 * COUNT][i];
        double value = 0.0, moment = 0.0;
        for (int k = 0; k < COUNT; k++) {
            const double t = p[k][i], c = p[COUNT + k][i], grown = exp(a * t), part = (grown - 1.0) / a;
            value += c * part;
            moment += c * t * grown;
            out[1 + k][i] = c * grown;
            out[1 + COUNT + k][i] = part;
        }
        out[0][i] = value;
        out[1 + 2 * COUNT][i] = (moment - value) / a;
    }
}

/* The integral of the greatest of ten lines over (0, 1): slopes, then heights. The upper hull, by slope. */
SCENE(greatest)
{
    enum { COUNT = 10 };
    for (long i = 0; i < n; i++) {
        int order[COUNT], hull[COUNT], size = 0;
        double from[COUNT], value = 0.0;
        for (int k = 0; k < COUNT; k++) {
            int j = k;
            for (; j > 0 && p[order[j - 1]][i] > p[k][i]; j--)
                order[j] = order[j - 1];
            order[j] = k;
            out[1 + k][i] = out[1 + COUNT + k][i] = 0.0;
        }
        for (int k = 0; k < COUNT; k++) {
            double start = -INFINITY;
            for (; size > 0; size--) {
                const int last = hull[size - 1];
                start = (p[COUNT + last][i] - p[COUNT + order[k]][i]) / (p[order[k]][i] - p[last][i]);
                if (start > from[size - 1])
                    break;
                start = -INFINITY;
            }
            hull[size] = order[k];
            from[size++] = start;
        }
        for (int k = 0; k < size; k++) {
            const double lo = fmax(from[k], 0.0), hi = fmin(k + 1 < size ? from[k + 1] : 1.0, 1.0);
            if (lo < hi) {
                const double length = hi - lo, moment = 0.5 * (hi + lo) * length;
                out[1 + hull[k]][i] = moment;
                out[1 + COUNT + hull[k]][i] = length;
                value += p[hull[k]][i] * moment + p[COUNT + hull[k]][i] * length;
            }
        }
        out[0][i] = value;
    }
}

/* The area of x^4 + a*y^4 < t, all of it inside the square. */
SCENE(superellipse)
{
    const double *t = p[0], *a = p[1], size = 4.0 * 0.927037338650685959; /* 4 gamma(5/4)^2 / gamma(3/2) */
#pragma GCC ivdep
    for (long i = 0; i < n; i++) {
        const double area = size * sqrt(t[i] / sqrt(a[i]));
        out[0][i] = area;
        out[1][i] = 0.5 * area / t[i];
        out[2][i] = -0.25 * area / a[i];
    }
}

/* The integral of exp(a*x)*cos(b*y) over the unit square. */
SCENE(exp_cos)
{
    const double *a = p[0], *b = p[1];
    for (long i = 0; i < n; i++) {
        const double less = expm1(a[i]), first = less / a[i], second = sin(b[i]) / b[i];
        out[0][i] = first * second;
        out[1][i] = (less + 1.0 - first) / a[i] * second;
        out[2][i] = first * (cos(b[i]) - second) / b[i];
    }
}
