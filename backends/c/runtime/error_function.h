/* The error function without branches or calls, by the expansions of teg/numerics/error_function.py. */

//: teg_erf_near
/* erf(x) / x, |x| <= 1, by powers of x * x. */
TEG_INLINE double teg_erf_near(double x)
{
    static const double c[] = {TEG_ERF_NEAR};
    const double s = x * x;
    double value = c[12];
    for (int k = 11; k >= 0; k--) value = value * s + c[k];
    return value;
}

//: teg_erfc_far
/* erfc(x), 1/2 <= x <= TEG_ERFC_FAREST. The exponential is taken in two parts: x * x is not rounded. */
TEG_INLINE double teg_erfc_far(double x)
{
    static const double c[] = {TEG_ERFC_FAR};
    const double u = ((x - TEG_ERFC_TURN) / (x + TEG_ERFC_TURN) - TEG_ERFC_CENTRE) / TEG_ERFC_REACH;
    const double head = (x + 6442450944.0) - 6442450944.0;
    double value = c[24];
    for (int k = 23; k >= 0; k--) value = value * u + c[k];
    value = teg_exp(-(head * head)) * (value / (1.0 + 2.0 * x));
    return value + value * teg_expm1((head - x) * (head + x));
}

//: teg_erf
/* erf(x) to two ulps. */
TEG_INLINE double teg_erf(double x)
{
    const double size = fabs(x) < TEG_ERFC_FAREST ? fabs(x) : TEG_ERFC_FAREST;
    const double near = x * teg_erf_near(size < 1.0 ? size : 1.0), far = 1.0 - teg_erfc_far(size > 1.0 ? size : 1.0);
    const double value = size < 1.0 ? near : x < 0.0 ? -far : far;
    return isnan(x) ? x : value;
}

//: teg_erfc
/* 1 - erf(x) to four ulps. */
TEG_INLINE double teg_erfc(double x)
{
    const double size = fabs(x) < TEG_ERFC_FAREST ? fabs(x) : TEG_ERFC_FAREST;
    const double near = 1.0 - x * teg_erf_near(size < 1.0 ? size : 1.0), far = teg_erfc_far(size > 0.5 ? size : 0.5);
    const double value = x < 0.5 && x > -1.0 ? near : x < 0.0 ? 2.0 - far : far;
    return isnan(x) ? x : value;
}
