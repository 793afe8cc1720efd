/* Arithmetic as the Python source does it: one rounding per operation, no contraction of
   a * b + c into one, no function replaced by what is nearly the same. */

#ifndef ARITHMETIC_H
#define ARITHMETIC_H

#include <math.h>
#include <stdint.h>
#include <string.h>

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

/* Distance from |x| to the next double, Python's math.ulp; x is finite. */
static inline double spacing(double x) {
    double here = fabs(x), next;
    uint64_t bits;
    memcpy(&bits, &here, sizeof bits);
    bits++;
    memcpy(&next, &bits, sizeof next);
    return next - here;
}

#endif
