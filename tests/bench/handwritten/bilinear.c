/* What a careful programmer would write by hand for one pixel of a thresholded, bilinearly interpolated noise: a yardstick for
   generated code.

   loss = integral over [0, 1]^2 of sum_k (colour_k - target_k)^2, the colour being `above` where the interpolation of four corner
   values exceeds the threshold and `below` elsewhere, and its derivatives by the corner values, the threshold and both colours.

   The border g = 0 is a hyperbola. In a pixel it has at most two branches, each from side to side, and each takes one logarithm:
   along it dx/g_y = -dy/g_x, the measure of the boundary integrals, is that of the logarithm of either slope. All is referred to
   the middle of the branch's chord, so nothing cancels where the hyperbola is nearly a line or passes the saddle closely. */

#include <math.h>

static const double SIDE_X[4] = {0.0, 1.0, 1.0, 0.0}, SIDE_Y[4] = {0.0, 0.0, 1.0, 1.0}; /* the corners, counterclockwise */

/* atanh(z)/z and (atanh(z)/z - 1)/z^2 from z^2; `ratio` is (1 + |z|)/(1 - |z|). */
static inline void logarithms(double square, double ratio, double *zeroth, double *first)
{
    if (square < 0.04) {
        double sum = 1.0 / 25.0;
        for (int k = 23; k >= 3; k -= 2) sum = sum * square + 1.0 / k;
        *first = sum;
        *zeroth = 1.0 + square * sum;
    } else {
        *zeroth = 0.5 * log(ratio) / sqrt(square);
        *first = (*zeroth - 1.0) / square;
    }
}

/* The branch from (x0, y0) to (x1, y1) of g with slopes b + d*y and c + d*x: the area between its chord and itself, and the integrals
   along it of the four corners' weights (00, 10, 11, 01). */
static inline double branch(double x0, double y0, double x1, double y1, double b, double c, double d, double *along)
{
    const double half_x = 0.5 * (x1 - x0), half_y = 0.5 * (y1 - y0), x = 0.5 * (x0 + x1), y = 0.5 * (y0 + y1);
    const double up0 = c + d * x0, up1 = c + d * x1, across0 = b + d * y0, across1 = b + d * y1;
    const double up = 0.5 * (up0 + up1), across = 0.5 * (across0 + across1);
    const int steep = fabs(across) >= fabs(up); /* divide by the larger slope */
    const double rate = steep ? -half_y / across : half_x / up;
    double ratio = fabs(steep ? across0 / across1 : up1 / up0), zeroth, first;
    if (ratio < 1.0) ratio = 1.0 / ratio;
    if (!(ratio < 1e24)) ratio = 1e24; /* an end on the asymptote, to rounding */
    const double z = d * rate;
    logarithms(z * z, ratio, &zeroth, &first);
    const double whole = 2.0 * rate * zeroth, in_x = -2.0 * half_x * (z * first) * rate, in_y = 2.0 * half_y * (z * first) * rate;
    const double in_both = -half_x * half_y * (4.0 * first - 2.0 * zeroth) * rate;
    const double sign = whole < 0.0 ? -1.0 : 1.0, rest_x = 1.0 - x, rest_y = 1.0 - y;
    along[0] += sign * (rest_x * rest_y * whole - rest_y * in_x - rest_x * in_y + in_both);
    along[1] += sign * (x * rest_y * whole + rest_y * in_x - x * in_y - in_both);
    along[2] += sign * (x * y * whole + y * in_x + x * in_y + in_both);
    along[3] += sign * (rest_x * y * whole - y * in_x + rest_x * in_y - in_both);
    return -2.0 * half_x * half_y * z * (zeroth - first);
}

/* Where g, with values f at the corners, is 0 on the side that begins at corner i. */
static inline void crossing(const double *f, int i, double *x, double *y)
{
    const int j = (i + 1) & 3;
    const double there = f[i] / (f[i] - f[j]), back = f[j] / (f[j] - f[i]);
    *x = i == 0 ? there : i == 1 ? 1.0 : i == 2 ? back : 0.0;
    *y = i == 0 ? 0.0 : i == 1 ? there : i == 2 ? 1.0 : back;
}

/* The area where g > 0, and its derivatives by the corner values, counterclockwise. */
static inline double area_above(const double *f, double *along)
{
    const int signs = (f[0] > 0.0) | (f[1] > 0.0) << 1 | (f[2] > 0.0) << 2 | (f[3] > 0.0) << 3;
    for (int i = 0; i < 4; i++) along[i] = 0.0;
    if (signs == 0 || signs == 15) return signs ? 1.0 : 0.0;
    const double b = f[1] - f[0], c = f[3] - f[0], d = (f[0] - f[1]) + (f[2] - f[3]);
    double x0, y0, x1, y1;
    if (signs != 5 && signs != 10) {
        int leaves = 0, enters = 0;
        for (int i = 0; i < 4; i++) {
            const int here = signs >> i & 1, next = signs >> ((i + 1) & 3) & 1;
            if (here && !next) leaves = i;
            if (next && !here) enters = i;
        }
        crossing(f, leaves, &x0, &y0);
        crossing(f, enters, &x1, &y1);
        double twice = 0.0, px = x1, py = y1;
        for (int i = (enters + 1) & 3;; i = (i + 1) & 3) {
            twice += (px - x0) * (SIDE_Y[i] - y0) - (SIDE_X[i] - x0) * (py - y0);
            px = SIDE_X[i];
            py = SIDE_Y[i];
            if (i == leaves) break;
        }
        return 0.5 * twice + branch(x0, y0, x1, y1, b, c, d, along);
    }
    /* two branches: two opposite corners are cut off, those below if the saddle is above */
    const double saddle = f[0] * f[2] - f[1] * f[3];
    const int joined = saddle != 0.0 && (saddle > 0.0) == (d > 0.0), first = (signs == 5) == joined;
    double off = 0.0;
    for (int i = first; i < 4; i += 2) {
        crossing(f, (i + 3) & 3, &x0, &y0);
        crossing(f, i, &x1, &y1);
        const double bulge = branch(x1, y1, x0, y0, b, c, d, along);
        off += 0.5 * fabs((x0 - SIDE_X[i]) * (y1 - SIDE_Y[i]) - (x1 - SIDE_X[i]) * (y0 - SIDE_Y[i])) + bulge;
    }
    return joined ? 1.0 - off : off;
}

/* corners: values at (0, 0), (1, 0), (0, 1), (1, 1), then the threshold; result: loss, by these five, by `above`, by `below`. */
static inline void bilinear_pixel(const double *corners, const double *above, const double *below, const double *target, double *result)
{
    const double t = corners[4], f[4] = {corners[0] - t, corners[1] - t, corners[3] - t, corners[2] - t};
    double along[4], loss_above = 0.0, loss_below = 0.0;
    const double area = area_above(f, along), rest = 1.0 - area;
    for (int k = 0; k < 3; k++) {
        const double u = above[k] - target[k], v = below[k] - target[k];
        loss_above += u * u;
        loss_below += v * v;
        result[6 + k] = 2.0 * area * u;
        result[9 + k] = 2.0 * rest * v;
    }
    const double jump = loss_above - loss_below;
    result[0] = area * loss_above + rest * loss_below;
    result[1] = jump * along[0];
    result[2] = jump * along[1];
    result[3] = jump * along[3];
    result[4] = jump * along[2];
    result[5] = -jump * (along[0] + along[1] + along[2] + along[3]);
}

/* n pixels, one after the other in each array; 12 results each. */
void bilinear_pixels(long n, const double *corners, const double *above, const double *below, const double *targets, double *results)
{
    for (long i = 0; i < n; i++) bilinear_pixel(corners + 5 * i, above + 3 * i, below + 3 * i, targets + 3 * i, results + 12 * i);
}
