/* The recorded equations of a component: C of its own (model.c), or a program that tape.c carries
   out. A kind of behaviour calls those that it has. */

#ifndef EQUATIONS_H
#define EQUATIONS_H

#include <stdint.h>

/* What depends on parameters alone. */
void model_constants(const double *v, double *c);
/* Why parameters are refused; NULL if they are not. */
const char *model_objection(const double *v);
void model_rates(double t, const double *x, const double *late, const double *v, const double *c,
                 double *dx);
void model_other_outputs(const double *x, const double *v, const double *c, double *out);
/* Their change for a change of the inputs. */
void model_outputs_change(const double *x, const double *v, const double *c,
                          const double *change, double *out);
/* Of a sample that is held for `elapsed`, or at that time. */
void model_law(double elapsed, const double *v, const double *c, double *out);
void model_compared(const double *x, const double *v, const double *c, double *out);
void model_decided(const double *x, const double *v, const double *c, double *out);

#endif
