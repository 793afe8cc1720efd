/* A row of the component's table of variables; its place is the value reference. */

#ifndef VARIABLE_H
#define VARIABLE_H

typedef enum { INPUT, OUTPUT, PARAMETER } Causality;
typedef enum { REAL, INTEGER } Kind;

typedef struct {
    const char *name;
    Causality causality;
    Kind kind;
    double start, minimum, maximum;
} Variable;

extern const Variable model_variables[];

#endif
