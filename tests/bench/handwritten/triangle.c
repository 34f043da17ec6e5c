/* What a careful programmer would write by hand for one triangle and one pixel: a yardstick for generated code.

   loss = integral over (triangle and pixel) of sum_k (colour_k - target_k)^2, and its derivatives by the six coordinates of the
   vertices and by all colours. Colours are of order 0 (one), 1 (one a vertex, linear between them) or 2 (one a vertex and one a
   middle of a side, quadratic).

   Inside: Sutherland and Hodgman's clipping, the clipped points carrying two barycentric coordinates so that colours of slivers need
   no division by their area, then a fan of triangles with a rule exact for the square of a colour. Border: each side cut by the
   pixel (Liang and Barsky), Gauss-Legendre on what is left. A side that lies on the pixel's border counts half: the mean of the
   two one-sided derivatives. All coordinates are taken relative to the middle of the pixel. */

#include <math.h>

#define ALWAYS static inline __attribute__((always_inline))

enum { OUTSIDE, COVERED, PARTIAL };

/* A point, and its barycentric coordinates with respect to the second and the third vertex. */
typedef struct {
    double x, y, second, third;
} corner;

ALWAYS double least(double a, double b, double c)
{
    const double d = a < b ? a : b;
    return d < c ? d : c;
}

ALWAYS double most(double a, double b, double c)
{
    const double d = a > b ? a : b;
    return d > c ? d : c;
}

/* The part of a polygon with sign*coordinate <= limit; a cut is always computed from the end that stays. */
ALWAYS int cut(int order, const corner *from, int n, corner *to, int vertical, double sign, double limit)
{
    int kept = 0;
    const corner *before = &from[n - 1];
    double room_before = limit - sign * (vertical ? before->y : before->x);
    for (int i = 0; i < n; i++) {
        const corner *here = &from[i];
        const double room = limit - sign * (vertical ? here->y : here->x);
        if ((room > 0.0 && room_before < 0.0) || (room < 0.0 && room_before > 0.0)) {
            const int leaving = room < 0.0;
            const corner *in = leaving ? before : here, *out = leaving ? here : before;
            const double left = leaving ? room_before : room, over = leaving ? room : room_before, part = left / (left - over);
            corner *const c = &to[kept++];
            c->x = vertical ? in->x + part * (out->x - in->x) : sign * limit;
            c->y = vertical ? sign * limit : in->y + part * (out->y - in->y);
            if (order > 0) {
                c->second = in->second + part * (out->second - in->second);
                c->third = in->third + part * (out->third - in->third);
            }
        }
        if (room >= 0.0) {
            to[kept].x = here->x;
            to[kept].y = here->y;
            if (order > 0) {
                to[kept].second = here->second;
                to[kept].third = here->third;
            }
            kept++;
        }
        before = here;
        room_before = room;
    }
    return kept;
}

/* Values at a point of the functions that the colours of order 1 or 2 are coefficients of. */
ALWAYS void shapes(int order, const double *l, double *value)
{
    if (order == 1) {
        for (int i = 0; i < 3; i++) value[i] = l[i];
    } else {
        for (int i = 0; i < 3; i++) {
            value[i] = l[i] * (2.0 * l[i] - 1.0);
            value[3 + i] = 4.0 * l[i] * l[i == 2 ? 0 : i + 1];
        }
    }
}

/* Of the points of a rule on a triangle: coordinates with respect to its second and third corner, weight. */
static const double MIDDLES[3][3] = {{0.5, 0.0, 1.0 / 3.0}, {0.5, 0.5, 1.0 / 3.0}, {0.0, 0.5, 1.0 / 3.0}};
#define NEAR_A 0.44594849091596488632
#define NEAR_B 0.10810301816807022736
#define NEAR_W 0.22338158967801146570
#define FAR_A 0.091576213509770743460
#define FAR_B 0.81684757298045851308
#define FAR_W 0.10995174365532186764
static const double SIX[6][3] = {{NEAR_A, NEAR_A, NEAR_W}, {NEAR_A, NEAR_B, NEAR_W}, {NEAR_B, NEAR_A, NEAR_W},
                                 {FAR_A, FAR_A, FAR_W},    {FAR_A, FAR_B, FAR_W},    {FAR_B, FAR_A, FAR_W}};

/* Nodes on (-1, 1) and weights. */
static const double ONE_NODE[1][2] = {{0.0, 2.0}};
static const double TWO_NODES[2][2] = {{-0.57735026918962576451, 1.0}, {0.57735026918962576451, 1.0}};
static const double THREE_NODES[3][2] = {
    {-0.77459666924148337704, 5.0 / 9.0}, {0.0, 8.0 / 9.0}, {0.77459666924148337704, 5.0 / 9.0}};

/* The part (from, to) of the side that begins at (x, y) and goes along (dx, dy) inside the box; whether there is one. */
ALWAYS int within(double x, double y, double dx, double dy, double wide, double high, double *from, double *to)
{
    const double tiny = 1e-290, per_x = 1.0 / (dx == 0.0 ? tiny : dx), per_y = 1.0 / (dy == 0.0 ? tiny : dy);
    const double x1 = (-wide - x) * per_x, x2 = (wide - x) * per_x, y1 = (-high - y) * per_y, y2 = (high - y) * per_y;
    double first = x1 < x2 ? x1 : x2, last = x1 < x2 ? x2 : x1;
    const double first_y = y1 < y2 ? y1 : y2, last_y = y1 < y2 ? y2 : y1;
    if (dx == 0.0 && fabs(x) == wide) first = -1.0, last = 2.0;
    if (!(dy == 0.0 && fabs(y) == high)) {
        first = first > first_y ? first : first_y;
        last = last < last_y ? last : last_y;
    }
    *from = first > 0.0 ? first : 0.0;
    *to = last < 1.0 ? last : 1.0;
    return *to > *from;
}

/* vertices: x0 y0 x1 y1 x2 y2; colours: three numbers each; box: left right bottom top; result: loss, by vertices, by colours. */
ALWAYS int triangle_pixel(int order, const double *vertices, const double *colours, const double *box, const double *target, double *result)
{
    const int functions = order == 0 ? 1 : order == 1 ? 3 : 6, outputs = 7 + 3 * functions;
    for (int i = 0; i < outputs; i++) result[i] = 0.0;
    const double middle_x = 0.5 * (box[0] + box[1]), middle_y = 0.5 * (box[2] + box[3]);
    const double wide = 0.5 * (box[1] - box[0]), high = 0.5 * (box[3] - box[2]);
    double x[3], y[3], dx[3], dy[3];
    for (int i = 0; i < 3; i++) {
        x[i] = vertices[2 * i] - middle_x;
        y[i] = vertices[2 * i + 1] - middle_y;
    }
    const double left = least(x[0], x[1], x[2]), right = most(x[0], x[1], x[2]);
    const double low = least(y[0], y[1], y[2]), top = most(y[0], y[1], y[2]);
    if (right < -wide || left > wide || top < -high || low > high) return OUTSIDE;
    const double twice = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]), turn = twice < 0.0 ? -1.0 : 1.0;
    int covered = 1;
    for (int i = 0; i < 3; i++) {
        const int j = i == 2 ? 0 : i + 1;
        dx[i] = x[j] - x[i];
        dy[i] = y[j] - y[i];
        const double at_middle = turn * (dy[i] * x[i] - dx[i] * y[i]), reach = fabs(dx[i]) * high + fabs(dy[i]) * wide;
        if (at_middle < -reach) return OUTSIDE;
        covered &= at_middle > reach;
    }
    if (twice == 0.0) return OUTSIDE;
    const double per_area = 1.0 / twice;
    double by_x[3], by_y[3]; /* slopes of the barycentric coordinates */
    for (int i = 0; i < 3; i++) {
        const int opposite = i == 2 ? 0 : i + 1;
        by_x[i] = -dy[opposite] * per_area;
        by_y[i] = dx[opposite] * per_area;
    }

    corner one[8], two[8];
    const corner *polygon = one;
    int n;
    if (covered) {
        const double second = -by_x[1] * x[0] - by_y[1] * y[0], third = -by_x[2] * x[0] - by_y[2] * y[0];
        for (int i = 0; i < 4; i++) {
            const double cx = i == 0 || i == 3 ? -wide : wide, cy = i < 2 ? -turn * high : turn * high;
            const corner c = {cx, cy, second + by_x[1] * cx + by_y[1] * cy, third + by_x[2] * cx + by_y[2] * cy};
            one[i] = c;
        }
        n = 4;
    } else {
        for (int i = 0; i < 3; i++) {
            const corner c = {x[i], y[i], i == 1, i == 2};
            one[i] = c;
        }
        n = 3;
        corner *now = one, *next = two;
#define CUT_IF(beyond, vertical, sign, limit) \
    if (n > 2 && (beyond)) { \
        n = cut(order, now, n, next, vertical, sign, limit); \
        corner *const used = now; \
        now = next; \
        next = used; \
    }
        CUT_IF(right > wide, 0, 1.0, wide)
        CUT_IF(left < -wide, 0, -1.0, wide)
        CUT_IF(top > high, 1, 1.0, high)
        CUT_IF(low < -high, 1, -1.0, high)
        polygon = now;
    }

    const int points = order == 0 ? 0 : order == 1 ? 3 : 6;
    const double(*const rule)[3] = order == 1 ? MIDDLES : SIX;
    double loss = 0.0, by_colour[18] = {0.0}, by_vertex[6] = {0.0}, whole = 0.0;
    const corner first = polygon[0];
    for (int i = 1; i + 1 < n; i++) {
        const corner b = polygon[i], c = polygon[i + 1];
        const double area = 0.5 * turn * ((b.x - first.x) * (c.y - first.y) - (c.x - first.x) * (b.y - first.y));
        whole += area;
        for (int q = 0; q < points; q++) {
            const double r = rule[q][0], s = rule[q][1], weight = area * rule[q][2];
            double l[3], value[6], residual[3], squares = 0.0;
            l[1] = first.second + r * (b.second - first.second) + s * (c.second - first.second);
            l[2] = first.third + r * (b.third - first.third) + s * (c.third - first.third);
            l[0] = 1.0 - l[1] - l[2];
            shapes(order, l, value);
            for (int k = 0; k < 3; k++) {
                double sum = -target[k];
                for (int m = 0; m < functions; m++) sum += value[m] * colours[3 * m + k];
                residual[k] = sum;
                squares += sum * sum;
            }
            loss += weight * squares;
            for (int m = 0; m < functions; m++)
                for (int k = 0; k < 3; k++) by_colour[3 * m + k] += 2.0 * weight * residual[k] * value[m];
            if (order == 2) { /* how the colour here changes as the vertices move */
                double gx = 0.0, gy = 0.0;
                for (int k = 0; k < 3; k++) {
                    double along[3], sx = 0.0, sy = 0.0;
                    for (int j = 0; j < 3; j++) {
                        const int after = j == 2 ? 0 : j + 1, before = j == 0 ? 2 : j - 1;
                        along[j] = (4.0 * l[j] - 1.0) * colours[3 * j + k] + 4.0 * l[after] * colours[9 + 3 * j + k] +
                                   4.0 * l[before] * colours[9 + 3 * before + k];
                        sx += along[j] * by_x[j];
                        sy += along[j] * by_y[j];
                    }
                    gx += residual[k] * sx;
                    gy += residual[k] * sy;
                }
                for (int j = 0; j < 3; j++) {
                    by_vertex[2 * j] -= 2.0 * weight * l[j] * gx;
                    by_vertex[2 * j + 1] -= 2.0 * weight * l[j] * gy;
                }
            }
        }
    }
    if (order == 0) {
        for (int k = 0; k < 3; k++) {
            const double residual = colours[k] - target[k];
            loss += whole * (residual * residual);
            by_colour[k] = 2.0 * whole * residual;
        }
    }
    if (order == 1) {
        for (int k = 0; k < 3; k++) {
            const double to_second = colours[3 + k] - colours[k], to_third = colours[6 + k] - colours[k];
            const double gx = to_second * by_x[1] + to_third * by_x[2], gy = to_second * by_y[1] + to_third * by_y[2];
            for (int j = 0; j < 3; j++) {
                by_vertex[2 * j] -= gx * by_colour[3 * j + k];
                by_vertex[2 * j + 1] -= gy * by_colour[3 * j + k];
            }
        }
    }

    const int nodes = order + 1;
    const double(*const line)[2] = order == 0 ? ONE_NODE : order == 1 ? TWO_NODES : THREE_NODES;
    for (int i = 0; !covered && i < 3; i++) {
        const int j = i == 2 ? 0 : i + 1;
        double from, to;
        if (!within(x[i], y[i], dx[i], dy[i], wide, high, &from, &to)) continue;
        const int shared = (dx[i] == 0.0 && fabs(x[i]) == wide) || (dy[i] == 0.0 && fabs(y[i]) == high);
        const double half = 0.5 * (to - from), middle = 0.5 * (to + from), part = shared ? 0.5 * half : half;
        double at_start = 0.0, at_end = 0.0;
        for (int q = 0; q < nodes; q++) {
            const double s = middle + half * line[q][0];
            double squares = 0.0;
            for (int k = 0; k < 3; k++) {
                double sum;
                if (order == 0) sum = colours[k];
                else if (order == 1) sum = colours[3 * i + k] + s * (colours[3 * j + k] - colours[3 * i + k]);
                else sum = (1.0 - s) * (1.0 - 2.0 * s) * colours[3 * i + k] + s * (2.0 * s - 1.0) * colours[3 * j + k] +
                           4.0 * s * (1.0 - s) * colours[9 + 3 * i + k];
                sum -= target[k];
                squares += sum * sum;
            }
            const double weighted = part * line[q][1] * squares;
            at_start += weighted * (1.0 - s);
            at_end += weighted * s;
        }
        const double nx = turn * dy[i], ny = -turn * dx[i];
        by_vertex[2 * i] += at_start * nx;
        by_vertex[2 * i + 1] += at_start * ny;
        by_vertex[2 * j] += at_end * nx;
        by_vertex[2 * j + 1] += at_end * ny;
    }
    result[0] = loss;
    for (int i = 0; i < 6; i++) result[1 + i] = by_vertex[i];
    for (int i = 0; i < 3 * functions; i++) result[7 + i] = by_colour[i];
    return covered ? COVERED : PARTIAL;
}

/* n pairs, one after the other in each array; the kinds are OUTSIDE, COVERED or PARTIAL. */
#define BATCH(order, count) \
    void triangle_pixels_##order( \
        long n, const double *vertices, const double *colours, const double *boxes, const double *targets, double *results, int *kinds) \
    { \
        for (long i = 0; i < n; i++) \
            kinds[i] = triangle_pixel(order, vertices + 6 * i, colours + 3 * (count) * i, boxes + 4 * i, targets + 3 * i, \
                                      results + (7 + 3 * (count)) * i); \
    }

BATCH(0, 1)
BATCH(1, 3)
BATCH(2, 6)
