/* Points of sampled integrals, and the errors of their means. */

//: teg_mix
/* Points of sampled integrals: see teg/numerics/sobol.py. 64 bits well mixed. */
static inline uint64_t teg_mix(uint64_t z)
{
    z = (z ^ z >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ z >> 27) * UINT64_C(0x94D049BB133111EB);
    return z ^ z >> 31;
}

//: teg_key
/* The 64 bits that tell one replicate of one dimension from all others. */
static inline uint64_t teg_key(uint64_t seed, int replicate, int dimension)
{
    return teg_mix(teg_mix(seed + UINT64_C(0x9E3779B97F4A7C15)) ^ ((uint64_t)replicate << 32 | (uint64_t)dimension));
}

//: teg_centre
/* The centre of a cell of width 2^-52. */
static inline double teg_centre(uint64_t cell)
{
    return (double)(int64_t)(2 * cell + 1) * 0x1p-53;
}

//: teg_random
/* The coordinate of a pseudo-random point. */
static inline double teg_random(uint64_t key, uint64_t index)
{
    return teg_centre(teg_mix(key + index * UINT64_C(0x9E3779B97F4A7C15)) >> 12);
}

//: teg_reversed
/* 32 bits in reverse. */
static inline uint32_t teg_reversed(uint32_t x)
{
    x = x >> 16 | x << 16;
    x = (x >> 8 & 0x00FF00FFu) | (x & 0x00FF00FFu) << 8;
    x = (x >> 4 & 0x0F0F0F0Fu) | (x & 0x0F0F0F0Fu) << 4;
    x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;
    return (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;
}

//: teg_scrambled
/* The coordinate of a Sobol' point, scrambled; x is the point's 32 bits in reverse. */
static inline double teg_scrambled(uint64_t key, uint32_t x)
{
    x ^= x * 0x3D20ADEAu;
    x = (x + (uint32_t)key) * ((uint32_t)(key >> 32) | 1u);
    x ^= x * 0x05526C56u;
    x ^= x * 0x53A22864u;
    const uint64_t upper = teg_reversed(x);
    return teg_centre(upper << 20 | teg_mix(key + upper * UINT64_C(0x9E3779B97F4A7C15)) >> 44);
}

//: teg_column
/* Which direction number leads from Sobol' point i to the next one, in the order of Gray's code. */
static inline int teg_column(uint64_t i)
{
    int column = 0;
    for (; i & 1u; i >>= 1) column++;
    return column;
}

//: teg_first_block
/* The first block of Sobol' points of a dimension, 32 bits in reverse. The points of another block differ from them by its first one. */
static inline void teg_first_block(uint32_t *points, const uint32_t *directions)
{
    points[0] = 0;
    for (int i = 0; i + 1 < TEG_BLOCK; i++) points[i + 1] = points[i] ^ directions[teg_column((uint64_t)i)];
}

//: teg_coordinates
/* The coordinates of the points of a block that begins with x. */
static inline void teg_coordinates(double *at, int n, uint64_t key, uint32_t x, const uint32_t *first_block)
{
    for (int k = 0; k < n; k++) at[k] = teg_scrambled(key, x ^ first_block[k]);
}

//: teg_next_block
/* The first point of the next block, from that of the block that begins with point i; TEG_BLOCK is 2^6. */
static inline uint32_t teg_next_block(uint32_t x, uint64_t i, const uint32_t *directions)
{
    return x ^ directions[5] ^ directions[6 + teg_column(i / TEG_BLOCK)];
}

//: teg_squares
/* Add up squares of n values relative to the first ones: `all` has n means, the first values, and the sums. */
static inline void teg_squares(int n, int first, const double *f, double *all)
{
    for (int j = 0; j < n; j++) {
        if (first) { all[n + j] = f[j]; all[2 * n + j] = 0.0; }
        all[2 * n + j] += (f[j] - all[n + j]) * (f[j] - all[n + j]);
    }
}

//: teg_standard_errors
/* Standard errors of n means over replicates of `each` points, from what `teg_squares` has of each replicate. */
static inline void teg_standard_errors(int n, int replicates, double each, const double *all, const double *mean, double *error)
{
    for (int j = 0; j < n; j++) {
        double scatter = 0.0, total = 0.0;
        for (int r = 0; r < replicates; r++) {
            const double *of = all + 3 * n * r + j;
            const double away = of[0] - of[n], squares = of[2 * n] - each * (away * away);
            scatter += (of[0] - mean[j]) * (of[0] - mean[j]);
            total += squares < 0.0 ? 0.0 : squares;
        }
        total += each * scatter;
        if (replicates == 1) {
            error[j] = sqrt(total / (each - 1.0) / each);
            continue;
        }
        const double variance = total / (replicates * each), square = scatter / (replicates * (replicates - 1.0));
        const int hidden = scatter <= TEG_SAME_MEANS * TEG_SAME_MEANS * (mean[j] * mean[j] + variance);
        error[j] = sqrt(hidden ? fmax(square, variance / (each * each)) : square);
    }
}
