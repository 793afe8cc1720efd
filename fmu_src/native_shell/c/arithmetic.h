/* Arithmetic as the Python source does it: one rounding per operation, no contraction of
   a * b + c into one, no function replaced by what is nearly the same. */

#ifndef ARITHMETIC_H
#define ARITHMETIC_H

#include <math.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

/* Compilers know pow(x, 2.0) as x * x, which a pow rounded elsewhere need not equal. */
static inline double power(double x, double y) {
    double (*volatile function)(double, double) = pow;
    return function(x, y);
}

/* Python's min(a, b) and max(a, b). */
static inline double lesser(double a, double b) { return b < a ? b : a; }
static inline double greater(double a, double b) { return b > a ? b : a; }

/* Distance from |x| to the next double, Python's math.ulp. */
static inline double spacing(double x) { return nextafter(fabs(x), HUGE_VAL) - fabs(x); }

#endif
