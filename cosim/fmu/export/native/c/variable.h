/* A row of the component's table of variables. Value references count its rows from 1: some
   importers take 0 for none. */

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

/* Row of a value reference; of 0, one beyond every table. */
static inline unsigned place(unsigned reference) { return reference - 1u; }

/* Greatest sizes of arrays: those of the model, unless it is read when an instance is made. */
#ifndef MODEL_IS_READ
extern const Variable model_variables[];
extern const char model_text[];
#define MOST_VARIABLES MODEL_VARIABLES
#define MOST_STATES MODEL_STATES
#define MOST_DELAYS MODEL_DELAYS
#define MOST_INPUTS MODEL_INPUTS
#define MOST_OUTPUTS MODEL_OUTPUTS
#define MOST_OTHERS MODEL_OTHERS
#define MOST_CONSTANTS MODEL_CONSTANTS
#endif

#endif
