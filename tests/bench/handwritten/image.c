/* What a careful programmer would write by hand for a picture and a mesh of triangles: a yardstick for generated code.

   loss = sum over triangles and the pixels of their bounding boxes of the loss of `triangle.c`, linear colours, and its derivatives by
   all vertices and colours. */

#include "triangle.c"

static inline int clamped(double at, int size)
{
    return at < 0.0 ? 0 : at > size ? size : (int)at;
}

/* vertices: two numbers each; faces: three vertices each; colours: nine numbers a face; picture: size*size pixels of three numbers, row by
   row. by_vertex and by_colour are added to. The loss; *pairs is how many pairs were looked at. */
double image_loss(
    int size, long count, const double *vertices, const int *faces, const double *colours, const double *picture, double *by_vertex,
    double *by_colour, long *pairs)
{
    double loss = 0.0;
    long seen = 0;
    for (long t = 0; t < count; t++) {
        double v[6], sum[16] = {0.0};
        for (int i = 0; i < 3; i++) {
            v[2 * i] = vertices[2 * faces[3 * t + i]];
            v[2 * i + 1] = vertices[2 * faces[3 * t + i] + 1];
        }
        const int left = clamped(floor(least(v[0], v[2], v[4])), size), right = clamped(ceil(most(v[0], v[2], v[4])), size);
        const int low = clamped(floor(least(v[1], v[3], v[5])), size), top = clamped(ceil(most(v[1], v[3], v[5])), size);
        for (int row = low; row < top; row++) {
            for (int column = left; column < right; column++) {
                const double box[4] = {column, column + 1.0, row, row + 1.0};
                double result[16];
                if (triangle_pixel(1, v, colours + 9 * t, box, picture + 3 * ((long)row * size + column), result) == OUTSIDE) continue;
                for (int i = 0; i < 16; i++) sum[i] += result[i];
            }
        }
        seen += (long)(top - low) * (right - left);
        loss += sum[0];
        for (int i = 0; i < 3; i++) {
            by_vertex[2 * faces[3 * t + i]] += sum[1 + 2 * i];
            by_vertex[2 * faces[3 * t + i] + 1] += sum[2 + 2 * i];
        }
        for (int i = 0; i < 9; i++) by_colour[9 * t + i] += sum[7 + i];
    }
    *pairs = seen;
    return loss;
}
