/* Elementary functions of vectors of doubles.
 *
 * Every lane takes the same path, so the result of a lane depends on nothing but its argument.
 * Argument reductions and rational approximations are those of Moshier, "Methods and Programs for
 * Mathematical Functions" (1989), the Cephes library. Arguments outside the range of a reduction
 * are handed lane by lane to the C library.
 */
#ifndef VECTOR_MATH_H
#define VECTOR_MATH_H

#include <math.h>

#ifndef W
#error "W, the number of lanes, is set by the compiler's command line"
#endif

typedef double V __attribute__((vector_size(8 * W)));
typedef long long M __attribute__((vector_size(8 * W)));
#define INLINE static inline __attribute__((always_inline, unused))

static const long long SIGN_BIT = (long long)0x8000000000000000ull;
/* adding it rounds a double below 2^51 to an integer, found in the low bits of the sum */
static const double ROUNDER = 6755399441055744.0; /* 1.5 * 2^52 */
static const long long ROUNDER_BITS = 0x4338000000000000ll;

INLINE V v_all(double value) { return value - (V){}; }
INLINE V v_where(M mask, V a) { return (V)(mask & (M)a); }
INLINE V v_select(M mask, V a, V b) { return (V)((mask & (M)a) | (~mask & (M)b)); }
INLINE V v_abs(V x) { return (V)((M)x & ~SIGN_BIT); }
/* as fmin and fmax: a NaN gives way to the other argument */
INLINE V v_min(V a, V b) { return v_select((a < b) | (b != b), a, b); }
INLINE V v_max(V a, V b) { return v_select((a > b) | (b != b), a, b); }
INLINE V v_copysign(V a, V b) { return (V)(((M)a & ~SIGN_BIT) | ((M)b & SIGN_BIT)); }
INLINE V v_sign(V x)
{
    return v_where(x > 0.0, v_all(1.0)) - v_where(x < 0.0, v_all(1.0)) + v_where(x != x, x);
}

INLINE V v_sqrt(V x)
{
    V y;
    for (int i = 0; i < W; i++)
        y[i] = __builtin_sqrt(x[i]);
    return y;
}

INLINE int v_any(M mask)
{
    long long any = 0;
    for (int i = 0; i < W; i++)
        any |= mask[i];
    return any != 0;
}

/* left to the C library, out of line: the lanes' loop would bloat every caller */
static __attribute__((noinline, unused)) V v_each(double (*f)(double), V x)
{
    V y;
    for (int i = 0; i < W; i++)
        y[i] = f(x[i]);
    return y;
}

static __attribute__((noinline, unused)) V v_each2(double (*f)(double, double), V a, V b)
{
    V y;
    for (int i = 0; i < W; i++)
        y[i] = f(a[i], b[i]);
    return y;
}

/* pi/2 in three parts; the first two have so few bits that their products with n are exact */
static const double HALF_PI_1 = 1.57079625129699707031e0;
static const double HALF_PI_2 = 7.54978941586159635335e-8;
static const double HALF_PI_3 = 5.39030285815811905290e-15;
static const double LARGEST_ANGLE = 1e6;

/* x = n pi/2 + r with |r| <= pi/4; returns r and the two low bits of n */
INLINE V reduced_angle(V x, M *quadrant)
{
    V shifted = x * 0.63661977236758134308 + ROUNDER;
    *quadrant = (M)shifted;
    V n = shifted - ROUNDER;
    return ((x - n * HALF_PI_1) - n * HALF_PI_2) - n * HALF_PI_3;
}

INLINE V sine_of_reduced(V r)
{
    V z = r * r;
    V s = z * 1.58962301576546568060e-10 - 2.50507477628578072866e-8;
    s = s * z + 2.75573136213857245213e-6;
    s = s * z - 1.98412698295895385996e-4;
    s = s * z + 8.33333333332211858878e-3;
    s = s * z - 1.66666666666666307295e-1;
    return r + r * z * s;
}

INLINE V cosine_of_reduced(V r)
{
    V z = r * r;
    V c = z * -1.13585365213876817300e-11 + 2.08757008419747316778e-9;
    c = c * z - 2.75573141792967388112e-7;
    c = c * z + 2.48015872888517045348e-5;
    c = c * z - 1.38888888888730564116e-3;
    c = c * z + 4.16666666666665929218e-2;
    return 1.0 - 0.5 * z + z * z * c;
}

/* sin(x + quarter pi/2) */
INLINE V sine_shifted(V x, long long quarter)
{
    M n;
    V r = reduced_angle(x, &n);
    n += quarter;
    M is_cosine = -(n & 1), is_negative = (n & 2) << 62;
    return (V)((M)v_select(is_cosine, cosine_of_reduced(r), sine_of_reduced(r)) ^ is_negative);
}

/* y, but f of the C library in the lanes of a mask */
INLINE V v_except(M lanes, double (*f)(double), V x, V y)
{
    return v_any(lanes) ? v_select(lanes, v_each(f, x), y) : y;
}

/* "not <=" is true for NaN too */
INLINE M too_large(V x) { return ~(v_abs(x) <= LARGEST_ANGLE); }

static __attribute__((noinline, unused)) V v_sin(V x)
{
    return v_except(too_large(x), sin, x, sine_shifted(x, 0));
}

static __attribute__((noinline, unused)) V v_cos(V x)
{
    return v_except(too_large(x), cos, x, sine_shifted(x, 1));
}

static __attribute__((noinline, unused)) V v_tan(V x)
{
    return v_except(too_large(x), tan, x, sine_shifted(x, 0) / sine_shifted(x, 1));
}

static __attribute__((noinline, unused)) V v_atan(V x)
{
    static const double TAN_3_PI_8 = 2.41421356237309504880, LOW_BITS = 6.123233995736765886130e-17;
    V a = v_abs(x);
    M far = a > TAN_3_PI_8, middle = (a > 0.66) & ~far;
    V base = v_select(far, v_all(1.57079632679489661923),
                      v_where(middle, v_all(0.78539816339744830962)));
    V low = v_select(far, v_all(LOW_BITS), v_where(middle, v_all(0.5 * LOW_BITS)));
    V t = v_select(far, -1.0 / a, v_select(middle, (a - 1.0) / (a + 1.0), a));
    V z = t * t;
    V p = z * -8.750608600031904122785e-1 - 1.615753718733365076637e1;
    p = p * z - 7.500855792314704667340e1;
    p = p * z - 1.228866684490136173410e2;
    p = p * z - 6.485021904942025371773e1;
    V q = z + 2.485846490142306297962e1;
    q = q * z + 1.650270098316988542046e2;
    q = q * z + 4.328810604912902668951e2;
    q = q * z + 4.853903996359136964868e2;
    q = q * z + 1.945506571482613964425e2;
    V y = base + ((t * (z * p / q) + t) + low);
    return v_copysign(v_select(x != x, x, y), x);
}

static __attribute__((noinline, unused)) V v_exp(V x)
{
    /* past these ends the result is infinite or 0; NaN stays */
    V inside = v_select(x < 720.0, v_select(x > -760.0, x, v_all(-760.0)), v_all(720.0));
    V shifted = inside * 1.4426950408889634073599 + ROUNDER;
    V n = shifted - ROUNDER;
    V r = (inside - n * 6.93145751953125e-1) - n * 1.42860682030941723212e-6;
    V z = r * r;
    V p = r * ((z * 1.26177193074810590878e-4 + 3.02994407707441961300e-2) * z
               + 9.99999999999999999910e-1);
    V q = z * 3.00198505138664455042e-6 + 2.52448340349684104192e-3;
    q = q * z + 2.27265548208155028766e-1;
    q = q * z + 2.00000000000000000009e0;
    V y = 1.0 + 2.0 * (p / (q - p));
    /* times 2^n in two factors, as 2^n alone may be beyond the exponent's range */
    M whole = (M)shifted - ROUNDER_BITS, half = whole >> 1;
    y = y * (V)((half + 1023) << 52) * (V)((whole - half + 1023) << 52);
    return v_select(x != x, x, y);
}

static __attribute__((noinline, unused)) V v_tanh(V x)
{
    V a = v_abs(x), z = x * x;
    V p = z * -9.64399179425052238628e-1 - 9.92877231001918586564e1;
    p = p * z - 1.61468768441708447952e3;
    V q = z + 1.12811678491632931402e2;
    q = q * z + 2.23548839060100448583e3;
    q = q * z + 4.84406305325125486048e3;
    V far = v_copysign(1.0 - 2.0 / (v_exp(a + a) + 1.0), x);
    return v_select(a > 0.625, far, x + x * z * p / q);
}

static __attribute__((noinline, unused)) V v_log(V x)
{
    static const double SMALLEST = 2.2250738585072014e-308, LARGEST = 1.7976931348623157e308;
    M unusual = ~((x >= SMALLEST) & (x <= LARGEST)); /* 0, negative, denormal, infinite, NaN */
    /* x = 2^e m with sqrt(1/2) <= m < sqrt(2) */
    M bits = (M)x;
    M e = (bits >> 52) - 1022;
    V m = (V)((bits & 0x000fffffffffffffll) | 0x3fe0000000000000ll);
    M small = m < 0.70710678118654752440;
    e += small;
    V t = v_select(small, m + m, m) - 1.0;
    V exponent = (V)(e + ROUNDER_BITS) - ROUNDER;
    V z = t * t;
    V p = t * 1.01875663804580931796e-4 + 4.97494994976747001425e-1;
    p = p * t + 4.70579119878881725854e0;
    p = p * t + 1.44989225341610930846e1;
    p = p * t + 1.79368678507819816313e1;
    p = p * t + 7.70838733755885391666e0;
    V q = t + 1.12873587189167450590e1;
    q = q * t + 4.52279145837532221105e1;
    q = q * t + 8.29875266912776603211e1;
    q = q * t + 7.11544750618563894466e1;
    q = q * t + 2.31251620126765340583e1;
    V y = t * (z * p / q) - exponent * 2.121944400546905827679e-4 - 0.5 * z;
    return v_except(unusual, log, x, (t + y) + exponent * 6.93359375e-1);
}

#endif
