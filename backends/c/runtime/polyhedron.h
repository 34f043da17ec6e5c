/* Half-spaces: polyhedra clipped by them, and nodes on these. */

//: teg_half_space
/* ((d + a*u) + b*v) + c*w > 0, or >= 0 if it is closed. */
typedef struct {
    double a, b, c, d;
    int closed;
} teg_half_space;

//: teg_solid_edge
/* An edge between two faces: around the first of them, counterclockwise from outside, it goes from one corner to another. */
typedef struct {
    int face, other, start, stop;
} teg_solid_edge;

//: teg_solid
/* A convex polyhedron; corners that no edge has are not of it. Faces 0 to 5 are the sides of the box, the others the half-spaces. */
typedef struct {
    int corners, edges;
    double *x, *y, *z;
    teg_solid_edge *edge;
} teg_solid;

//: teg_start_box
/* A box: corner 4i + 2j + k is at the far end in x, y and z if i, j and k are 1. */
static inline void teg_start_box(teg_solid *s, const double *extents)
{
    static const teg_solid_edge edges[12] = {
        {0, 2, 0, 1}, {0, 3, 3, 2}, {0, 4, 2, 0}, {0, 5, 1, 3}, {1, 2, 5, 4}, {1, 3, 6, 7},
        {1, 4, 4, 6}, {1, 5, 7, 5}, {2, 4, 0, 4}, {2, 5, 5, 1}, {3, 4, 6, 2}, {3, 5, 3, 7},
    };
    s->corners = 8, s->edges = 12;
    for (int i = 0; i < 8; i++) {
        s->x[i] = i & 4 ? extents[0] : 0.0;
        s->y[i] = i & 2 ? extents[1] : 0.0;
        s->z[i] = i & 1 ? extents[2] : 0.0;
    }
    memcpy(s->edge, edges, sizeof edges);
}

//: teg_clip_solid
/* Cut a polyhedron by a half-space, which becomes the face of this number; corners that are outside by no more than `tolerance` stay. */
static inline void teg_clip_solid(teg_solid *s, int number, const teg_half_space *g, double tolerance)
{
    double height[TEG_SOLID];
    int leaves[TEG_SOLID_FACES], enters[TEG_SOLID_FACES], kept = 0;
    for (int i = 0; i < s->corners; i++) height[i] = ((g->d + g->a * s->x[i]) + g->b * s->y[i]) + g->c * s->z[i];
    for (int f = 0; f < number; f++) leaves[f] = enters[f] = -1;
    for (int k = 0; k < s->edges; k++) {
        teg_solid_edge e = s->edge[k];
        const int goes_out = height[e.stop] < -tolerance, comes_in = height[e.start] < -tolerance;
        if (goes_out & comes_in) continue;
        if (goes_out | comes_in) {
            const int in = goes_out ? e.start : e.stop, out = goes_out ? e.stop : e.start, new = s->corners++;
            const double high = height[in] > 0.0 ? height[in] : 0.0, t = high / (high - height[out]);
            s->x[new] = s->x[in] + t * (s->x[out] - s->x[in]);
            s->y[new] = s->y[in] + t * (s->y[out] - s->y[in]);
            s->z[new] = s->z[in] + t * (s->z[out] - s->z[in]);
            leaves[goes_out ? e.face : e.other] = enters[goes_out ? e.other : e.face] = new;
            if (goes_out) e.stop = new;
            else e.start = new;
        }
        s->edge[kept++] = e;
    }
    s->edges = kept;
    for (int f = 0; f < number; f++) {
        if (leaves[f] < 0 || enters[f] < 0) continue;
        const teg_solid_edge e = {f, number, leaves[f], enters[f]};
        s->edge[s->edges++] = e;
    }
}

//: teg_polyhedron
/* A box cut by half-spaces: the number of its edges, 0 if nothing is left, -1 if that is not known. */
static inline int teg_polyhedron(teg_solid *s, int n, const teg_half_space *g, const double *extents)
{
    double least[TEG_HALF_SPACES], scale[TEG_HALF_SPACES];
    int known = isfinite(extents[0]) && isfinite(extents[1]) && isfinite(extents[2]);
    for (int i = 0; i < n; i++) {
        const double u = g[i].a * extents[0], v = g[i].b * extents[1], w = g[i].c * extents[2];
        const double most = g[i].d + (u <= 0.0 ? 0.0 : u) + (v <= 0.0 ? 0.0 : v) + (w <= 0.0 ? 0.0 : w);
        least[i] = g[i].d + (u >= 0.0 ? 0.0 : u) + (v >= 0.0 ? 0.0 : v) + (w >= 0.0 ? 0.0 : w);
        scale[i] = fabs(g[i].d) + (fabs(u) + fabs(v) + fabs(w));
        if (most <= 0.0 && !(g[i].closed && least[i] >= 0.0)) return 0;
        known &= isfinite(most - least[i]);
    }
    if (!known) return -1;
    teg_start_box(s, extents);
    for (int i = 0; i < n; i++)
        if (least[i] < 0.0) teg_clip_solid(s, 6 + i, g + i, TEG_CLIP_EPS * scale[i]);
    return s->edges;
}

//: teg_middles
/* The means of the ends of edges, of all and of each face's: `middle`, and those of faces up to this number. */
static inline void teg_middles(const teg_solid *s, int faces, double *middle, double (*of_face)[3])
{
    int count[TEG_SOLID_FACES];
    middle[0] = middle[1] = middle[2] = 0.0;
    for (int f = 0; f < faces; f++) count[f] = 0, of_face[f][0] = of_face[f][1] = of_face[f][2] = 0.0;
    for (int k = 0; k < s->edges; k++) {
        const teg_solid_edge *e = s->edge + k;
        const double p[3] = {s->x[e->start], s->y[e->start], s->z[e->start]}, q[3] = {s->x[e->stop], s->y[e->stop], s->z[e->stop]};
        for (int j = 0; j < 3; j++) middle[j] += p[j] + q[j], of_face[e->face][j] += p[j], of_face[e->other][j] += q[j];
        count[e->face]++, count[e->other]++;
    }
    for (int j = 0; j < 3; j++) middle[j] /= 2 * s->edges;
    for (int f = 0; f < faces; f++)
        for (int j = 0; j < 3; j++) of_face[f][j] /= count[f] > 0 ? count[f] : 1;
}

//: teg_tetrahedron
/* The tetrahedron of the middle, the middle of a face, and an edge around it: three sides from the first corner; returns its volume. */
static inline double teg_tetrahedron(
    const teg_solid *s, int number, const double *middle, const double (*of_face)[3], double (*sides)[3])
{
    const teg_solid_edge *e = s->edge + number / 2;
    const int turned = number % 2, face = turned ? e->other : e->face, p = turned ? e->stop : e->start, q = turned ? e->start : e->stop;
    const double at[3][3] = {
        {of_face[face][0], of_face[face][1], of_face[face][2]}, {s->x[p], s->y[p], s->z[p]}, {s->x[q], s->y[q], s->z[q]},
    };
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) sides[i][j] = at[i][j] - middle[j];
    const double *const u = sides[0], *const v = sides[1], *const w = sides[2];
    return (u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) + u[2] * (v[0] * w[1] - v[1] * w[0])) / 6.0;
}

//: teg_volume
/* The volume of a polyhedron with faces up to this number, and a place inside. */
static inline double teg_volume(const teg_solid *s, int faces, double *at)
{
    double of_face[TEG_SOLID_FACES][3], twice[TEG_SOLID_FACES][3], volume = 0.0;
    teg_middles(s, faces, at, of_face);
    for (int f = 0; f < faces; f++) twice[f][0] = twice[f][1] = twice[f][2] = 0.0;
    for (int k = 0; k < s->edges; k++) {
        const teg_solid_edge *e = s->edge + k;
        const double px = s->x[e->start] - at[0], py = s->y[e->start] - at[1], pz = s->z[e->start] - at[2];
        const double qx = s->x[e->stop] - at[0], qy = s->y[e->stop] - at[1], qz = s->z[e->stop] - at[2];
        const double across[3] = {py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx};
        for (int j = 0; j < 3; j++) twice[e->face][j] += across[j], twice[e->other][j] -= across[j];
    }
    for (int f = 0; f < faces; f++)
        for (int j = 0; j < 3; j++) volume += (of_face[f][j] - at[j]) * twice[f][j];
    return volume / 6.0;
}

//: teg_centroid
/* The centroid of a polyhedron with faces up to this number; returns its volume. */
static inline double teg_centroid(const teg_solid *s, int faces, double *at)
{
    double middle[3], of_face[TEG_SOLID_FACES][3], sides[3][3], volume = 0.0, moment[3] = {0.0, 0.0, 0.0};
    teg_middles(s, faces, middle, of_face);
    for (int k = 0; k < 2 * s->edges; k++) {
        const double part = teg_tetrahedron(s, k, middle, (const double (*)[3])of_face, sides);
        volume += part;
        for (int j = 0; j < 3; j++) moment[j] += 0.25 * part * (sides[0][j] + sides[1][j] + sides[2][j]);
    }
    for (int j = 0; j < 3; j++) at[j] = middle[j] + (volume != 0.0 ? moment[j] / volume : 0.0);
    return volume;
}

//: teg_tetrahedra
/* The nodes of a rule on tetrahedra from this number on, so many at most; how many nodes they are. */
static inline int teg_tetrahedra(
    const teg_solid *s, int first, int most, const double *middle, const double (*of_face)[3], int nodes, const double (*rule)[4],
    double *x, double *y, double *z, double *weights)
{
    const int last = first + most < 2 * s->edges ? first + most : 2 * s->edges;
    int n = 0;
    for (int k = first; k < last; k++) {
        double sides[3][3];
        const double volume = teg_tetrahedron(s, k, middle, of_face, sides);
        for (int i = 0; i < nodes; i++, n++) {
            const double *const r = rule[i];
            x[n] = middle[0] + r[0] * sides[0][0] + r[1] * sides[1][0] + r[2] * sides[2][0];
            y[n] = middle[1] + r[0] * sides[0][1] + r[1] * sides[1][1] + r[2] * sides[2][1];
            z[n] = middle[2] + r[0] * sides[0][2] + r[1] * sides[1][2] + r[2] * sides[2][2];
            weights[n] = volume * r[3];
        }
    }
    for (int i = n; i % 8; i++) x[i] = x[n - 1], y[i] = y[n - 1], z[i] = z[n - 1], weights[i] = 0.0;
    return n;
}
