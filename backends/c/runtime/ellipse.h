/* Ellipses on a convex polygon, a box or what half-planes leave of it: chords of the sides, arcs between them, and moments by nodes along
   the arcs. Points are offsets (u, v) from the point of the box that is nearest to the centre, and w = A*((u, v) - centre), in which the
   ellipse is a circle around 0. */

//: teg_arc
/* An arc: where it begins, in both planes, and its angle. */
typedef struct {
    double u, v, p, q, angle;
} teg_arc;

//: teg_ellipse
/* The part of an ellipse in a polygon: the nearest point, chords (from, to) of sides, arcs, and a point inside; the sign of the area. */
typedef struct {
    double from_u, from_v, chord[TEG_SIDES][4], u, v, sign;
    int chords, arcs;
    teg_arc arc[TEG_SIDES];
} teg_ellipse;

//: teg_box_beside
/* Whether a disk is beyond a side of the box; `reach` is how far the ellipse of radius 1 reaches along u and v. */
static inline int teg_box_beside(const double *reach, double u, double v, double radius, double width, double height)
{
    const double far_u = radius * reach[0], far_v = radius * reach[1];
    const double low_u = width < 0.0 ? width : 0.0, high_u = width < 0.0 ? 0.0 : width;
    const double low_v = height < 0.0 ? height : 0.0, high_v = height < 0.0 ? 0.0 : height;
    return u - far_u > high_u || u + far_u < low_u || v - far_v > high_v || v + far_v < low_v;
}

//: teg_box_around
/* Whether a disk is inside of all sides of the box, or touches them to rounding. */
static inline int teg_box_around(const double *reach, double u, double v, double radius, double width, double height)
{
    const double far_u = radius * (1.0 - TEG_TANGENT) * reach[0], far_v = radius * (1.0 - TEG_TANGENT) * reach[1];
    const double low_u = width < 0.0 ? width : 0.0, high_u = width < 0.0 ? 0.0 : width;
    const double low_v = height < 0.0 ? height : 0.0, high_v = height < 0.0 ? 0.0 : height;
    return u - low_u >= far_u && high_u - u >= far_u && v - low_v >= far_v && high_v - v >= far_v;
}

//: teg_planes_around
/* Whether it is inside of all half-planes; b is the inverse of A. */
static inline int teg_planes_around(int n, const teg_half_plane *g, const double *b, double u, double v, double radius)
{
    for (int i = 0; i < n; i++) {
        const double reach = hypot(b[0] * g[i].a + b[2] * g[i].b, b[1] * g[i].a + b[3] * g[i].b);
        if (!((g[i].c + g[i].a * u) + g[i].b * v >= radius * (1.0 - TEG_TANGENT) * reach)) return 0;
    }
    return 1;
}

//: teg_counterclockwise
/* Turns the corners of a clipped box round where its area counts negatively. */
static inline void teg_counterclockwise(int n, double *px, double *py, double width, double height)
{
    if ((width < 0.0) == (height < 0.0)) return;
    for (int i = 0, j = n - 1; i < j; i++, j--) {
        const double x = px[i], y = py[i];
        px[i] = px[j];
        py[i] = py[j];
        px[j] = x;
        py[j] = y;
    }
}

//: teg_trace_sides
/* A polygon that is all in the ellipse. */
static inline void teg_trace_sides(teg_ellipse *e, int n, const double *px, const double *py, double width, double height)
{
    e->from_u = e->from_v = e->u = e->v = 0.0;
    e->sign = (width < 0.0) != (height < 0.0) ? -1.0 : 1.0;
    e->chords = n;
    e->arcs = 0;
    for (int i = 0, last = n - 1; i < n; last = i++) {
        e->chord[i][0] = px[last];
        e->chord[i][1] = py[last];
        e->chord[i][2] = px[i];
        e->chord[i][3] = py[i];
        e->u += px[i] / n;
        e->v += py[i] / n;
    }
}

//: teg_trace_ellipse
/* The part of an ellipse in a polygon of n corners, counterclockwise, the last one again the first; a is A, b its inverse. `around`: the
   disk is inside of the lines of all sides. */
static inline void teg_trace_ellipse(teg_ellipse *e, const double *a, const double *b, double u0, double v0, double radius, double width,
    double height, int n, const double *px, const double *py, int around)
{
    const double low_u = width < 0.0 ? width : 0.0, high_u = width < 0.0 ? 0.0 : width;
    const double low_v = height < 0.0 ? height : 0.0, high_v = height < 0.0 ? 0.0 : height;
    e->from_u = u0 < low_u ? low_u : u0 > high_u ? high_u : u0;
    e->from_v = v0 < low_v ? low_v : v0 > high_v ? high_v : v0;
    u0 -= e->from_u;
    v0 -= e->from_v;
    const double whole = a[0] * a[3] - a[1] * a[2];
    double u[TEG_SIDES + 1], v[TEG_SIDES + 1], p[TEG_SIDES + 1], q[TEG_SIDES + 1], end[TEG_SIDES][2];
    int in[TEG_SIDES + 1], leaves[TEG_SIDES], enters[TEG_SIDES];
    e->chords = e->arcs = 0;
    e->sign = (width < 0.0) != (height < 0.0) ? -1.0 : 1.0;
    e->u = e->v = 0.0;
    for (int i = 0; i <= n; i++) {
        u[i] = px[i] - e->from_u;
        v[i] = py[i] - e->from_v;
        p[i] = a[0] * (u[i] - u0) + a[1] * (v[i] - v0);
        q[i] = a[2] * (u[i] - u0) + a[3] * (v[i] - v0);
        in[i] = p[i] * p[i] + q[i] * q[i] < radius * radius;
    }
    teg_arc begin[TEG_SIDES];
    for (int i = 0; i < n; i++) {
        const double over = u[i + 1] - u[i], up = v[i + 1] - v[i];
        double dp = a[0] * over + a[1] * up, dq = a[2] * over + a[3] * up;
        const double square = dp * dp + dq * dq;
        leaves[i] = enters[i] = 0;
        if (!(square > 0.0)) continue;
        const double length = sqrt(square), shorter = 1.0 / length;
        dp *= shorter;
        dq *= shorter;
        const double away = whole * ((u[i] - u0) * up - (v[i] - v0) * over) * shorter, inside = (radius - away) * (radius + away);
        if (!in[i] && !in[i + 1] && !(inside > 0.0)) continue;
        const double half = inside > 0.0 ? sqrt(inside) : 0.0, foot = -(p[i] * dp + q[i] * dq);
        if (!in[i] && !in[i + 1] && !(foot > 0.0 && foot < length)) continue;
        double start = in[i] ? 0.0 : (foot - half) * shorter, stop = in[i + 1] ? 1.0 : (foot + half) * shorter;
        start = start < 0.0 ? 0.0 : start > 1.0 ? 1.0 : start;
        stop = stop < 0.0 ? 0.0 : stop > 1.0 ? 1.0 : stop;
        double *chord = e->chord[e->chords++];
        chord[0] = u[i] + start * over;
        chord[1] = v[i] + start * up;
        chord[2] = u[i] + stop * over;
        chord[3] = v[i] + stop * up;
        for (int k = 0; k < 2; k++) {
            if (in[i + k]) continue;
            const double shift = k ? half : -half;
            double s = away * dq + shift * dp, t = -away * dp + shift * dq;
            if (radius < length) {
                chord[2 * k] = u0 + (b[0] * s + b[1] * t);
                chord[2 * k + 1] = v0 + (b[2] * s + b[3] * t);
            } else { /* a short side has no digits of its direction */
                s = a[0] * (chord[2 * k] - u0) + a[1] * (chord[2 * k + 1] - v0);
                t = a[2] * (chord[2 * k] - u0) + a[3] * (chord[2 * k + 1] - v0);
            }
            if (k) {
                leaves[i] = 1;
                begin[i] = (teg_arc){chord[2], chord[3], s, t, 0.0};
            } else {
                enters[i] = 1;
                end[i][0] = s;
                end[i][1] = t;
            }
        }
        e->u += chord[0] + chord[2];
        e->v += chord[1] + chord[3];
    }
    if (width == 0.0 || height == 0.0) return;
    if (e->chords == 0) {
        if (around) {
            e->u = u0;
            e->v = v0;
            e->arcs = 1;
            e->arc[0] = (teg_arc){u0 + b[0] * radius, v0 + b[2] * radius, radius, 0.0, 2.0 * TEG_PI};
        }
        return;
    }
    e->u *= 0.5 / e->chords;
    e->v *= 0.5 / e->chords;
    int behind = 0, close = 0;
    double least = 0.0;
    for (int i = 0; i < n; i++) {
        if (!leaves[i]) continue;
        int j = i + 1 < n ? i + 1 : 0;
        while (j != i && !enters[j]) j = j + 1 < n ? j + 1 : 0;
        const double s = end[j][0], t = end[j][1];
        teg_arc arc = begin[i];
        const double gap = sqrt((arc.p - s) * (arc.p - s) + (arc.q - t) * (arc.q - t)), across = arc.p * t - arc.q * s;
        if (gap < TEG_CLOSE_ENDS * radius) {
            arc.angle = gap / radius;
            if (!close++ || across < least) {
                behind = e->arcs;
                least = across;
            }
        } else {
            arc.angle = atan2(across, arc.p * s + arc.q * t);
            if (arc.angle < 0.0) arc.angle += 2.0 * TEG_PI;
        }
        e->arc[e->arcs++] = arc;
    }
    if (around && close && close == e->arcs) e->arc[behind].angle = 2.0 * TEG_PI - e->arc[behind].angle;
}

//: teg_trace_box
/* The part of an ellipse in a box. */
static void teg_trace_box(teg_ellipse *e, const double *a, const double *b, const double *reach, double u, double v, double radius,
    double width, double height)
{
    const double low_u = width < 0.0 ? width : 0.0, high_u = width < 0.0 ? 0.0 : width;
    const double low_v = height < 0.0 ? height : 0.0, high_v = height < 0.0 ? 0.0 : height;
    const double px[5] = {low_u, high_u, high_u, low_u, low_u}, py[5] = {low_v, low_v, high_v, high_v, low_v};
    const int around = teg_box_around(reach, u, v, radius, width, height);
    teg_trace_ellipse(e, a, b, u, v, radius, width, height, 4, px, py, around);
}

//: teg_trace_polygon
/* The part of an ellipse in a box clipped by half-planes, with room for the first corner after the last one. */
static void teg_trace_polygon(teg_ellipse *e, const double *a, const double *b, const double *reach, double u, double v, double radius,
    double width, double height, int corners, double *px, double *py, int planes, const teg_half_plane *g)
{
    px[corners] = px[0];
    py[corners] = py[0];
    const int around = teg_box_around(reach, u, v, radius, width, height) && teg_planes_around(planes, g, b, u, v, radius);
    teg_trace_ellipse(e, a, b, u, v, radius, width, height, corners, px, py, around);
}

//: teg_turned
/* Sine, and cosine less 1, of n angles of at most pi: by those of a quarter, doubled twice. */
static inline void teg_turned(int n, const double *angle, double *sine, double *rise)
{
    for (int i = 0; i < n; i++) {
        const double x = 0.25 * angle[i], y = x * x;
        double s = x * (1.0 + y * (-1.0 / 6.0 + y * (1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0 +
            y * (-1.0 / 39916800.0 + y * (1.0 / 6227020800.0 - y * (1.0 / 1307674368000.0))))))));
        double r = y * (-0.5 + y * (1.0 / 24.0 + y * (-1.0 / 720.0 + y * (1.0 / 40320.0 + y * (-1.0 / 3628800.0 +
            y * (1.0 / 479001600.0 + y * (-1.0 / 87178291200.0 + y * (1.0 / 20922789888000.0))))))));
        for (int k = 0; k < 2; k++) {
            const double twice = 2.0 * s * (1.0 + r);
            r = -2.0 * s * s;
            s = twice;
        }
        sine[i] = s;
        rise[i] = r;
    }
}

//: teg_total
/* The sum of eight numbers. */
static inline double teg_total(const double *x)
{
    return ((x[0] + x[1]) + (x[2] + x[3])) + ((x[4] + x[5]) + (x[6] + x[7]));
}

//: teg_nodes_on_arc
/* Nodes on an arc, in eights: u and v, the derivatives by the angle, weights, and if `seen` both numbers of w; the arc begins where this
   one ends. b is the inverse of A, `node` has the nodes and, from n on, the weights of the rule. */
static inline void teg_nodes_on_arc(int n, const double *node, const double *b, teg_arc *arc, double angle, int seen, double *x)
{
    double turned[17], sine[17], rise[17];
    const double half = 0.5 * angle;
    for (int i = 0; i < n; i++) turned[i] = half * node[i];
    turned[n] = half;
    teg_turned(n + 1, turned, sine, rise);
    const double p = arc->p, q = arc->q, s = sine[n], r = rise[n];
    const double over = r * p - s * q, up = r * q + s * p, mp = p + over, mq = q + up; /* from the begin to the middle */
    const double u = arc->u + b[0] * over + b[1] * up, v = arc->v + b[2] * over + b[3] * up;
    const double away_u = b[0] * mp + b[1] * mq, away_v = b[2] * mp + b[3] * mq;
    const double along_u = b[1] * mp - b[0] * mq, along_v = b[3] * mp - b[2] * mq;
    for (int i = 0; i < n; i++) {
        x[i] = u + (rise[i] * away_u + sine[i] * along_u);
        x[n + i] = v + (rise[i] * away_v + sine[i] * along_v);
        x[2 * n + i] = (1.0 + rise[i]) * along_u - sine[i] * away_u;
        x[3 * n + i] = (1.0 + rise[i]) * along_v - sine[i] * away_v;
        x[4 * n + i] = half * node[n + i];
        if (seen) {
            x[5 * n + i] = mp + (rise[i] * mp - sine[i] * mq);
            x[6 * n + i] = mq + (rise[i] * mq + sine[i] * mp);
        }
    }
    const double over_2 = r * mp - s * mq, up_2 = r * mq + s * mp;
    arc->u = u + b[0] * over_2 + b[1] * up_2;
    arc->v = v + b[2] * over_2 + b[3] * up_2;
    arc->p = mp + over_2;
    arc->q = mq + up_2;
}
