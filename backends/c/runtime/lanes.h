/* Numbers side by side. */

//: teg_fma
/* x y + z, rounded once where that is one operation. */
static inline double teg_fma(double x, double y, double z)
{
#ifdef FP_FAST_FMA
    return fma(x, y, z);
#else
    return x * y + z;
#endif
}

//: teg_lanes_2
/* Numbers side by side. */
#ifdef __GNUC__
typedef double __attribute__((vector_size(16), aligned(8), may_alias)) teg_lanes_2;
#else
typedef double teg_lanes_2;
#endif

//: teg_lanes_4
/* Numbers side by side. */
#ifdef __GNUC__
typedef double __attribute__((vector_size(32), aligned(8), may_alias)) teg_lanes_4;
#else
typedef double teg_lanes_4;
#endif

//: teg_lanes_8
/* Numbers side by side. */
#ifdef __GNUC__
typedef double __attribute__((vector_size(64), aligned(8), may_alias)) teg_lanes_8;
#else
typedef double teg_lanes_8;
#endif

//: teg_fma_8
/* x y + z, rounded once where that is one operation. Some of the three are numbers side by side: a difference from 0 makes them of one
   number. */
#if defined(__AVX512F__) && defined(__GNUC__) && !defined(__clang__)
#define teg_fma_8(x, y, z) \
    ((teg_lanes_8)__builtin_ia32_vfmaddpd512_mask( \
        (x) - (teg_lanes_8){0.0}, (y) - (teg_lanes_8){0.0}, (z) - (teg_lanes_8){0.0}, -1, 4))
#else
#define teg_fma_8(x, y, z) ((x) * (y) + (z))
#endif

//: teg_flags_8
/* Flags side by side: all bits of a number, or none. */
#ifdef __GNUC__
typedef long long __attribute__((vector_size(64), aligned(8), may_alias)) teg_flags_8;
#else
typedef int teg_flags_8;
#endif

//: teg_choose_8
/* Of numbers side by side those of x where g > 0, else those of y. */
static inline void teg_choose_8(teg_lanes_8 *chosen, const teg_lanes_8 *g, const teg_lanes_8 *x, const teg_lanes_8 *y)
{
    const teg_flags_8 above = (teg_flags_8)(*g > 0.0);
#ifdef __GNUC__
    *chosen = (teg_lanes_8)((above & (teg_flags_8)*x) | (~above & (teg_flags_8)*y));
#else
    *chosen = above ? *x : *y;
#endif
}

//: teg_total_2
static inline double teg_total_2(const teg_lanes_2 *lanes)
{
#ifdef __GNUC__
    const teg_lanes_2 x = *lanes;
    return x[0] + x[1];
#else
    return *lanes;
#endif
}

//: teg_total_4
static inline double teg_total_4(const teg_lanes_4 *lanes)
{
#ifdef __GNUC__
    const teg_lanes_2 *const halves = (const teg_lanes_2 *)lanes, x = halves[0] + halves[1];
    return x[0] + x[1];
#else
    return *lanes;
#endif
}

//: teg_total_8
static inline double teg_total_8(const teg_lanes_8 *lanes)
{
#ifdef __GNUC__
    const teg_lanes_4 *const halves = (const teg_lanes_4 *)lanes, x = halves[0] + halves[1];
    const teg_lanes_2 *const quarters = (const teg_lanes_2 *)&x, y = quarters[0] + quarters[1];
    return y[0] + y[1];
#else
    return *lanes;
#endif
}

//: teg_pick
/* x where a condition holds that is the same for all numbers side by side, else y. */
TEG_INLINE double teg_pick(int holds, double x, double y)
{
    const uint64_t mask = holds ? UINT64_MAX : 0;
    uint64_t first, second;
    memcpy(&first, &x, sizeof first);
    memcpy(&second, &y, sizeof second);
    first = (first & mask) | (second & ~mask);
    memcpy(&x, &first, sizeof x);
    return x;
}
