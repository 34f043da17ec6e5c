/* Half-planes: polygons clipped by them, nodes on these, and parts of segments. */

//: teg_half_plane
/* (c + a*u) + b*v > 0, or >= 0 if it is closed. */
typedef struct {
    double a, b, c;
    int closed;
} teg_half_plane;

//: teg_clip
/* A polygon cut by a half-plane; the new number of its corners, for which there is room. */
static inline int teg_clip(int n, double *px, double *py, const teg_half_plane *g, int room)
{
    double d[TEG_CORNERS], qx[TEG_CORNERS], qy[TEG_CORNERS];
    int kept = 0, m = 0;
    for (int i = 0; i < n; i++) {
        d[i] = g->c + g->a * px[i] + g->b * py[i];
        kept += d[i] >= 0.0;
    }
    if (kept == n || kept == 0 || n + n / 2 > room) return kept ? n : 0; /* a convex one never has so many */
    for (int i = 0, last = n - 1; i < n; last = i++) {
        const double p = d[last], q = d[i];
        if ((p > 0.0 && q < 0.0) || (p < 0.0 && q > 0.0)) {
            const int in = p > 0.0 ? last : i, out = p > 0.0 ? i : last;
            const double t = d[in] / (d[in] - d[out]);
            qx[m] = px[in] + t * (px[out] - px[in]);
            qy[m] = py[in] + t * (py[out] - py[in]);
            m++;
        }
        qx[m] = px[i];
        qy[m] = py[i];
        m += q >= 0.0;
    }
    for (int i = 0; i < m; i++) {
        px[i] = qx[i];
        py[i] = qy[i];
    }
    return m;
}

//: teg_meets
/* Whether no half-plane fails on the box from (0, 0) to (width, height): 0 if one does, -1 if that is not known; and their least
   values. */
static inline int teg_meets(int n, const teg_half_plane *g, double width, double height, double *least)
{
    int known = isfinite(width) && isfinite(height);
    for (int i = 0; i < n; i++) {
        const double u = g[i].a * width, v = g[i].b * height;
        const double most = g[i].c + (u <= 0.0 ? 0.0 : u) + (v <= 0.0 ? 0.0 : v);
        least[i] = g[i].c + (u >= 0.0 ? 0.0 : u) + (v >= 0.0 ? 0.0 : v);
        if (most <= 0.0 && !(g[i].closed && least[i] >= 0.0)) return 0;
        known &= isfinite(most - least[i]);
    }
    return known ? 1 : -1;
}

//: teg_clipped_box
/* That box cut by half-planes with these least values: the number of its corners, 0 if nothing is left. */
static inline int teg_clipped_box(
    int n, const teg_half_plane *g, double width, double height, const double *least, double *px, double *py)
{
    int corners = 4;
    px[0] = px[3] = py[0] = py[1] = 0.0;
    px[1] = px[2] = width;
    py[2] = py[3] = height;
    for (int i = 0; i < n; i++)
        if (least[i] < 0.0) corners = teg_clip(corners, px, py, g + i, 2 * (4 + n));
    return corners;
}

//: teg_polygon
/* The same, or -1 if that is not known. */
static inline int teg_polygon(int n, const teg_half_plane *g, double width, double height, double *px, double *py)
{
    double least[TEG_HALF_PLANES];
    const int meets = teg_meets(n, g, width, height, least);
    return meets > 0 ? teg_clipped_box(n, g, width, height, least, px, py) : meets;
}

//: teg_clip_carrying
/* As teg_clip, a polygon whose vertices carry two numbers more; the new ones are exactly on a side of the box. */
static inline int teg_clip_carrying(int n, double *const *p, const teg_half_plane *g, int room, int side)
{
    double d[TEG_CORNERS], q[4][TEG_CORNERS];
    int kept = 0, m = 0;
    for (int i = 0; i < n; i++) {
        d[i] = g->c + g->a * p[0][i] + g->b * p[1][i];
        kept += d[i] >= 0.0;
    }
    if (kept == n || kept == 0 || n + n / 2 > room) return kept ? n : 0;
    for (int i = 0, last = n - 1; i < n; last = i++) {
        if ((d[last] > 0.0 && d[i] < 0.0) || (d[last] < 0.0 && d[i] > 0.0)) {
            const int in = d[last] > 0.0 ? last : i, out = d[last] > 0.0 ? i : last;
            const double t = d[in] / (d[in] - d[out]);
            for (int j = 0; j < 4; j++) q[j][m] = p[j][in] + t * (p[j][out] - p[j][in]);
            if (side) q[g->a == 0.0][m] = -g->c * (g->a + g->b);
            m++;
        }
        for (int j = 0; j < 4; j++) q[j][m] = p[j][i];
        m += d[i] >= 0.0;
    }
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < m; i++) p[j][i] = q[j][i];
    return m;
}

//: teg_thin
/* A triangle cut by the box, and by half-planes from number 3 on, with its barycentric coordinates. */
static inline int teg_thin(
    int n, const teg_half_plane *g, double width, double height, const double (*at)[2], double *const *p)
{
    const double su = width < 0.0 ? -1.0 : 1.0, sv = height < 0.0 ? -1.0 : 1.0;
    const teg_half_plane sides[4] = {
        {su, 0.0, 0.0, 0}, {-su, 0.0, su * width, 0}, {0.0, sv, 0.0, 0}, {0.0, -sv, sv * height, 0}};
    const double turn =
        (at[1][0] - at[0][0]) * (at[2][1] - at[0][1]) - (at[2][0] - at[0][0]) * (at[1][1] - at[0][1]);
    const int second = turn * su * sv < 0.0 ? 2 : 1, from[3] = {0, second, 3 - second};
    int corners = 3;
    for (int k = 0; k < 3; k++) {
        p[0][k] = at[from[k]][0];
        p[1][k] = at[from[k]][1];
        p[2][k] = from[k] == 1;
        p[3][k] = from[k] == 2;
    }
    for (int i = 0; i < 4; i++) corners = teg_clip_carrying(corners, p, sides + i, 2 * (4 + n), 1);
    for (int i = 3; i < n; i++) corners = teg_clip_carrying(corners, p, g + i, 2 * (4 + n), 0);
    return corners;
}

//: teg_triangle
/* As teg_polygon, of a triangle's half-planes, and maybe others; of a thin one with its barycentric coordinates at the corners. */
static inline int teg_triangle(
    int n, const teg_half_plane *g, double width, double height, const double (*at)[2], double across, double *const *p, int *thin)
{
    double least[TEG_HALF_PLANES], swing = 0.0;
    const int meets = teg_meets(n, g, width, height, least);
    if (meets <= 0) return meets;
    if (!isfinite(across)) return -1;
    if (across <= 0.0) return 0;
    for (int i = 0; i < 3; i++) {
        const double change = fabs(g[i].a * width) + fabs(g[i].b * height);
        if (change > swing) swing = change;
    }
    *thin = across < TEG_THIN * swing;
    return *thin ? teg_thin(n, g, width, height, at, p) : teg_clipped_box(n, g, width, height, least, p[0], p[1]);
}

//: teg_pad
/* Up to seven nodes without a weight, so that nodes can be taken by eights. */
static inline void teg_pad(int n, double *x, double *y, double *w)
{
    for (int i = n; i % 8; i++) {
        x[i] = x[0];
        y[i] = y[0];
        w[i] = 0.0;
    }
}

//: teg_fan_0
/* One node that counts for a whole polygon. */
static inline int teg_fan_0(int corners, const double *px, const double *py, double *x, double *y, double *w)
{
    if (corners < 3) return 0;
    double twice = 0.0;
    for (int k = 1; k + 1 < corners; k++)
        twice += (px[k] - px[0]) * (py[k + 1] - py[0]) - (px[k + 1] - px[0]) * (py[k] - py[0]);
    x[0] = px[0];
    y[0] = py[0];
    w[0] = 0.5 * twice;
    return 1;
}

//: teg_rectangle_2
/* The nodes that teg_fan_2 has on a rectangle from the origin, eight numbers at a time. */
static inline int teg_rectangle_2(double width, double height, double *x, double *y, double *w)
{
    static const double at[3][8] = {
        {0.5, 1.0, 0.5, 0.5, 0.0, 0.5, 0.5, 0.5},
        {0.0, 0.5, 0.5, 1.0, 0.5, 0.0, 0.0, 0.0},
        {1.0 / 6.0, 1.0 / 6.0, 1.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0, 0.0, 0.0, 0.0}};
    const double area = width * height;
    for (int i = 0; i < 8; i++) {
        x[i] = width * at[0][i];
        y[i] = height * at[1][i];
        w[i] = area * at[2][i];
    }
    return 5;
}

//: teg_fan_2
/* The middles of the sides of the triangles of a fan, which integrate degree 2; how many they are. */
static inline int teg_fan_2(int corners, const double *px, const double *py, double *x, double *y, double *w)
{
    if (corners < 3) return 0;
    if (corners == 4 && px[0] == 0.0 && px[3] == 0.0 && px[1] == px[2] && py[0] == 0.0 && py[1] == 0.0 && py[2] == py[3] &&
        isfinite(px[2] * py[2]))
        return teg_rectangle_2(px[2], py[2], x, y, w);
    double before = 0.0;
    int n = 0;
    for (int k = 1; k + 1 < corners; k++) {
        const double ux = px[k] - px[0], uy = py[k] - py[0], vx = px[k + 1] - px[0], vy = py[k + 1] - py[0];
        const double third = (ux * vy - vx * uy) * (1.0 / 6.0);
        x[n] = px[0] + 0.5 * ux;
        y[n] = py[0] + 0.5 * uy;
        w[n++] = before + third;
        x[n] = px[k] + 0.5 * (px[k + 1] - px[k]);
        y[n] = py[k] + 0.5 * (py[k + 1] - py[k]);
        w[n++] = third;
        before = third;
    }
    x[n] = px[0] + 0.5 * (px[corners - 1] - px[0]);
    y[n] = py[0] + 0.5 * (py[corners - 1] - py[0]);
    w[n++] = before;
    teg_pad(n, x, y, w);
    return n;
}

//: teg_fan
/* The nodes of a rule on the triangles of a fan; how many they are. */
static inline int teg_fan(
    int corners, const double *px, const double *py, int nodes, const double (*rule)[3], double *x, double *y, double *w)
{
    int n = 0;
    for (int k = 1; k + 1 < corners; k++) {
        const double ux = px[k] - px[0], uy = py[k] - py[0], vx = px[k + 1] - px[0], vy = py[k + 1] - py[0];
        const double area = 0.5 * (ux * vy - vx * uy);
        for (int i = 0; i < nodes; i++, n++) {
            x[n] = px[0] + rule[i][0] * ux + rule[i][1] * vx;
            y[n] = py[0] + rule[i][0] * uy + rule[i][1] * vy;
            w[n] = area * rule[i][2];
        }
    }
    teg_pad(n, x, y, w);
    return n;
}

//: teg_affine
/* An affine function, relative to a number, at nodes, by eights. */
static inline void teg_affine(int nodes, const teg_half_plane *g, double scale, const double *x, const double *y, double *at)
{
    const double a = g->a, b = g->b, c = g->c;
    for (int i = 0; i < nodes; i += 8)
        for (int k = i; k < i + 8; k++) at[k] = (c + a * x[k] + b * y[k]) * scale;
}

//: teg_carry_0
/* What nodes of teg_fan_0, teg_fan_2 and teg_fan have of what the corners of the polygon have. */
static inline void teg_carry_0(int corners, const double *p, double *at)
{
    for (int i = 0; i < 8; i++) at[i] = corners > 2 ? p[0] : 0.0;
}

//: teg_carry_2
static inline void teg_carry_2(int corners, const double *p, double *at)
{
    int n = 0;
    for (int k = 1; k + 1 < corners; k++) {
        at[n++] = p[0] + 0.5 * (p[k] - p[0]);
        at[n++] = p[k] + 0.5 * (p[k + 1] - p[k]);
    }
    if (corners < 3) return;
    at[n++] = p[0] + 0.5 * (p[corners - 1] - p[0]);
    for (int i = n; i % 8; i++) at[i] = at[0];
}

//: teg_carry
static inline void teg_carry(int corners, const double *p, int nodes, const double (*rule)[3], double *at)
{
    int n = 0;
    for (int k = 1; k + 1 < corners; k++)
        for (int i = 0; i < nodes; i++) at[n++] = p[0] + rule[i][0] * (p[k] - p[0]) + rule[i][1] * (p[k + 1] - p[0]);
    for (int i = n; i % 8; i++) at[i] = at[0];
}

//: teg_interval_cut
/* What half-lines leave of (0, 1): whether one excludes all of it, and whether one is not a number. */
typedef struct {
    double from, to;
    int outside, undefined;
} teg_interval_cut;

//: teg_cut
static inline void teg_cut(teg_interval_cut *cut, double first, double last, int closed)
{
    const double root = first / (first - last);
    cut->outside |= first <= 0.0 && last <= 0.0 && !(closed && first == 0.0 && last == 0.0);
    cut->undefined |= !isfinite(first - last);
    if (first < 0.0 && last > 0.0 && root > cut->from) cut->from = root;
    if (first > 0.0 && last < 0.0 && root < cut->to) cut->to = root;
}

//: teg_is_near
static inline int teg_is_near(double first, double last, double size)
{
    return fabs(first) <= TEG_NEARLY * size && fabs(last) <= TEG_NEARLY * size && isfinite(first - last);
}

//: teg_ties
static inline int teg_ties(teg_context *ctx, teg_interval_cut *cut, double first, double last, double scale, int holds)
{
    if (!(fabs(first) <= TEG_TIE_EPS * scale && fabs(last) <= TEG_TIE_EPS * scale)) return 0;
    ctx->tied = 1;
    if (ctx->order > 1 || ctx->order < -1) holds = 1;
    cut->outside |= ctx->order > 0 ? !holds : holds;
    return 1;
}
