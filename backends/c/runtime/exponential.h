/* Exponentials and logarithms without branches or calls, so that loops with them are computed side by side. */

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

//: teg_log
/* log(x) to an ulp: x = 2^n * (1 + g), |g| < 0.42, and log(1 + g) = g - f * (g - tail) with f = g/(2 + g) and
   tail = 2 * (f^2/3 + f^4/5 + ...). */
TEG_INLINE double teg_log(double x)
{
    const double scaled = x < 2.2250738585072014e-308 ? x * 18014398509481984.0 : x;
    uint64_t bits, exponent;
    double n, m;
    memcpy(&bits, &scaled, sizeof bits);
    exponent = (bits >> 52) | UINT64_C(0x4330000000000000);
    bits = (bits & UINT64_C(0x000fffffffffffff)) | UINT64_C(0x3ff0000000000000);
    memcpy(&n, &exponent, sizeof n);
    memcpy(&m, &bits, sizeof m);
    n = n - (x < 2.2250738585072014e-308 ? 4503599627371573.0 : 4503599627371519.0);
    n = m > 1.4142135623730951 ? n + 1.0 : n;
    m = m > 1.4142135623730951 ? 0.5 * m : m;
    const double g = m - 1.0, f = g / (2.0 + g), s = f * f, t = s * s;
    const double a = 0.6666666666666666 + s * 0.4, b = 0.2857142857142857 + s * 0.2222222222222222;
    const double c = 0.18181818181818182 + s * 0.15384615384615385, d = 0.13333333333333333 + s * 0.11764705882352941;
    const double e = 0.10526315789473684 + s * 0.09523809523809523;
    const double tail = s * ((a + t * b) + (t * t) * ((c + t * d) + (t * t) * e));
    const double value = n * 0.693147180369123816490 - ((f * (g - tail) - n * 1.90821492927058770002e-10) - g);
    const double finite = x < INFINITY ? value : x;
    return x > 0.0 ? finite : x < 0.0 || isnan(x) ? NAN : -INFINITY;
}
