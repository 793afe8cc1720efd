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

/* glibc 2.29 gave these functions a new version that differs in error handling alone, which
   nothing here uses: a library that asks for the first one runs on older systems too. The
   linker has to be given libm (-lm) for it, so a build must ask for it. */
#if defined(OLDEST_LIBM) && defined(__GLIBC__)
#if __GLIBC_PREREQ(2, 29) && defined(__x86_64__)
#define FIRST_VERSION "GLIBC_2.2.5"
#elif __GLIBC_PREREQ(2, 29) && defined(__aarch64__)
#define FIRST_VERSION "GLIBC_2.17"
#endif
#ifdef FIRST_VERSION
__asm__(".symver pow,pow@" FIRST_VERSION);
__asm__(".symver exp,exp@" FIRST_VERSION);
__asm__(".symver log,log@" FIRST_VERSION);
__asm__(".symver log2,log2@" FIRST_VERSION);
#endif
#endif

/* Compilers know pow(x, 2.0) as x * x, which a pow rounded elsewhere need not equal. */
static inline double power(double x, double y) {
    double (*volatile function)(double, double) = pow;
    return function(x, y);
}

/* Python's min(a, b) and max(a, b). */
static inline double lesser(double a, double b) { return b < a ? b : a; }
static inline double greater(double a, double b) { return b > a ? b : a; }

/* Comparisons of expressions: 1 or 0. */
static inline double less(double a, double b) { return a < b; }
static inline double less_equal(double a, double b) { return a <= b; }
static inline double equal(double a, double b) { return a == b; }

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
