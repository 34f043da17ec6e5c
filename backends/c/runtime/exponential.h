/* The exponential function without branches or calls, so that loops with it are computed side by side. */

//: teg_reduced
/* x as n * log(2) + r with |r| <= log(2)/2; `n` holds n in its lowest bits too. */
TEG_INLINE double teg_reduced(double x, double *n)
{
    *n = x * 1.4426950408889634 + 6755399441055744.0;
    const double whole = *n - 6755399441055744.0;
    return (x - whole * 0.693147180369123816490) - whole * 1.90821492927058770002e-10;
}

//: teg_two_to
/* 2^n of such an n between -1022 and 1023. */
TEG_INLINE double teg_two_to(double n)
{
    uint64_t bits;
    double power;
    memcpy(&bits, &n, sizeof bits);
    bits = (bits << 52) + UINT64_C(0x3ff0000000000000);
    memcpy(&power, &bits, sizeof power);
    return power;
}

//: teg_exponential_tail
/* exp(r) - 1 - r for |r| <= log(2)/2: Taylor's series. */
TEG_INLINE double teg_exponential_tail(double r)
{
    const double s = r * r, t = s * s;
    const double a = 0.5 + r * 0.16666666666666666 + s * (0.041666666666666664 + r * 0.008333333333333333);
    const double b = 0.001388888888888889 + r * 0.0001984126984126984 + s * (2.48015873015873e-05 + r * 2.7557319223985893e-06);
    const double c = 2.755731922398589e-07 + r * 2.505210838544172e-08 + s * (2.08767569878681e-09 + r * 1.6059043836821613e-10);
    return s * (a + t * (b + t * c));
}

//: teg_exp
/* exp(x) to an ulp. */
TEG_INLINE double teg_exp(double x)
{
    double n;
    x = x > 1400.0 ? 1400.0 : x;
    x = x < -1400.0 ? -1400.0 : x;
    const double r = teg_reduced(x, &n), whole = n - 6755399441055744.0;
    const double half = 0.5 * whole + 6755399441055744.0, other = (whole - (half - 6755399441055744.0)) + 6755399441055744.0;
    return ((1.0 + (r + teg_exponential_tail(r))) * teg_two_to(half)) * teg_two_to(other);
}

//: teg_expm1
/* exp(x) - 1 to two ulps. */
TEG_INLINE double teg_expm1(double x)
{
    double n;
    x = x > 710.0 ? 710.0 : x;
    x = x < -60.0 ? -60.0 : x;
    const double r = teg_reduced(x, &n), scale = teg_two_to(n - 1.0);
    return 2.0 * (scale * (r + teg_exponential_tail(r)) + (scale - 0.5));
}
