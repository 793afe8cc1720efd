/* A model that is data: resources/model.bin of the FMU, read when the first instance is made.

   The binary is the same for every component of a kind. Equations are the recorded tape: the
   operations that C of them would do, in the same order, and so the same bits. */

#ifndef TAPE_H
#define TAPE_H

#include <stddef.h>
#include <stdint.h>

#include "equations.h"
#include "message.h"

#define MODEL_IS_READ
#include "variable.h"

#define MOST_VARIABLES 4096
#define MOST_STATES 64
#define MOST_DELAYS 8
#define MOST_INPUTS 128
#define MOST_OUTPUTS 128
#define MOST_OTHERS 128
#define MOST_CONSTANTS 1024
#define MOST_REFERENCES 128
#define MOST_MEASURED MOST_REFERENCES
#define MOST_DECIDED (2 * (MOST_OUTPUTS + MOST_REFERENCES) + 2)
#define MOST_SLOTS 2048

/* An operation on numbers of arrays; an operand is array * 2^32 + index. */
typedef struct {
    int64_t operation, a, b, to;
} Operation;

typedef struct {
    const Operation *operation;
    size_t operations, results;
    const int64_t *result; /* operands */
} Program;

enum { CONSTANTS_OF_A_RUN, RATES, OUTPUT_VALUES, OUTPUT_CHANGES, CONDITIONS, LAW, COMPARED,
       DECIDED, PROGRAMS };
enum { TO_INPUTS, TO_OUTPUTS, TO_STATES, TO_INITIALS, TO_DELAYS, TO_OTHERS, TO_NAMED,
       TO_MEASURED, TO_ACTING, TO_WATCHED, TO_PLAY, TABLES };
enum { LATE_FROM, LATE_TO, RUN_CONSTANTS, ROWS_OF_TABLE, NUMBERS };

typedef struct {
    const char *guid, *text;
    size_t variables;
    Variable *variable;
    int64_t number[NUMBERS];
    size_t count[TABLES];
    unsigned reference[TABLES][MOST_REFERENCES];
    Program program[PROGRAMS];
    const double *pool; /* numbers of the equations */
    size_t pooled;
    const char **objection;
    const int64_t *instant;
    const double *table;
} Model;

extern Model model;

/* Read the model of `resources`, a path or a file URI, unless an instance has it; 0 with why. */
int model_take(const char *resources, Message *why);
/* Give it back: it is freed with the last instance. */
void model_leave(void);

#define MODEL_GUID (model.guid)
#define MODEL_VARIABLES ((int)model.variables)
#define MODEL_STATES (model.count[TO_STATES])
#define MODEL_INPUTS (model.count[TO_INPUTS])
#define MODEL_OUTPUTS (model.count[TO_OUTPUTS])
#define MODEL_OTHERS (model.count[TO_OTHERS])
#define MODEL_DELAYS (model.count[TO_DELAYS])
#define MODEL_MEASURED (model.count[TO_MEASURED])
#define MODEL_ACTING (model.count[TO_ACTING])
#define MODEL_WATCHED (model.count[TO_WATCHED])
#define MODEL_PLAY (model.count[TO_PLAY])
#define MODEL_CONSTANTS (model.number[RUN_CONSTANTS])
#define MODEL_ROWS (model.number[ROWS_OF_TABLE])
#define LATE_BEGIN ((size_t)model.number[LATE_FROM])
#define LATE_END ((size_t)model.number[LATE_TO])

#define model_variables (model.variable)
#define model_inputs (model.reference[TO_INPUTS])
#define model_outputs (model.reference[TO_OUTPUTS])
#define model_states (model.reference[TO_STATES])
#define model_initials (model.reference[TO_INITIALS])
#define model_delays (model.reference[TO_DELAYS])
#define model_others (model.reference[TO_OTHERS])
#define model_measured (model.reference[TO_MEASURED])
#define model_acting (model.reference[TO_ACTING])
#define model_watched (model.reference[TO_WATCHED])
#define model_play (model.reference[TO_PLAY])
#define model_text (model.text)
#define model_instants (model.instant)
#define model_table (model.table)

#endif
