/* Sine and cosine without branches or calls, so that loops with them are computed side by side. */

//: teg_near_turns
/* Whether sine and cosine of x can be computed here: |x| <= 10^6. */
TEG_INLINE int teg_near_turns(double x)
{
    return fabs(x) <= 1e6;
}

//: teg_quarter_turns
/* x as n * pi/2 + r with |r| <= pi/4 for |x| <= 10^6; `n` holds n in its lowest bits too. The first two parts of pi/2 have 33
   bits. */
TEG_INLINE double teg_quarter_turns(double x, double *n)
{
    *n = x * 0.6366197723675814 + 6755399441055744.0;
    const double whole = *n - 6755399441055744.0;
    return ((x - whole * 1.5707963267341256) - whole * 6.077100506303966e-11) - whole * 2.0222662487959506e-21;
}

//: teg_small_sine
/* sin(r) for |r| <= pi/4: Taylor's series. */
TEG_INLINE double teg_small_sine(double r)
{
    const double s = r * r, t = s * s;
    const double a = -0.16666666666666666 + s * 0.008333333333333333, b = -0.0001984126984126984 + s * 2.7557319223985893e-06;
    const double c = -2.505210838544172e-08 + s * 1.6059043836821613e-10, d = -7.647163731819816e-13 + s * 2.8114572543455206e-15;
    return r + r * (s * ((a + t * b) + (t * t) * (c + t * d)));
}

//: teg_small_cosine
/* cos(r) for |r| <= pi/4: Taylor's series, and what rounding takes from 1 - r*r/2. */
TEG_INLINE double teg_small_cosine(double r)
{
    const double s = r * r, t = s * s, half = 0.5 * s, first = 1.0 - half;
    const double a = 0.041666666666666664 + s * -0.001388888888888889, b = 2.48015873015873e-05 + s * -2.755731922398589e-07;
    const double c = 2.08767569878681e-09 + s * -1.1470745597729725e-11, d = 4.779477332387385e-14 + s * -1.5619206968586225e-16;
    return first + (((1.0 - first) - half) + t * ((a + t * b) + (t * t) * (c + t * d)));
}

//: teg_wave
/* The sine of n quarter turns and an angle of which `sine` and `cosine` are given. */
TEG_INLINE double teg_wave(double n, double shift, double sine, double cosine)
{
    uint64_t bits, sign;
    n += shift;
    memcpy(&bits, &n, sizeof bits);
    double value = bits & 1 ? cosine : sine;
    memcpy(&sign, &value, sizeof sign);
    sign ^= (bits & 2) << 62;
    memcpy(&value, &sign, sizeof value);
    return value;
}

//: teg_sine
/* sin(x) to an ulp, where teg_near_turns. */
TEG_INLINE double teg_sine(double x)
{
    double n;
    const double r = teg_quarter_turns(x, &n);
    return teg_wave(n, 0.0, teg_small_sine(r), teg_small_cosine(r));
}

//: teg_cosine
/* cos(x) to an ulp, where teg_near_turns. */
TEG_INLINE double teg_cosine(double x)
{
    double n;
    const double r = teg_quarter_turns(x, &n);
    return teg_wave(n, 1.0, teg_small_sine(r), teg_small_cosine(r));
}
