#include "message.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int say(Message *message, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message->text, sizeof message->text, format, arguments);
    va_end(arguments);
    return 0;
}

Number shortest(double x) {
    Number number;
    if (isnan(x)) {
        strcpy(number.text, "nan");
        return number;
    }
    if (isinf(x)) {
        strcpy(number.text, x > 0 ? "inf" : "-inf");
        return number;
    }
    for (int digits = 1; digits <= 17; digits++) {
        snprintf(number.text, sizeof number.text - 2, "%.*g", digits, x);
        if (strtod(number.text, NULL) == x) break;
    }
    for (char *c = number.text; *c; c++)
        if (*c == ',') *c = '.'; /* a host may have set a locale */
    if (strcspn(number.text, ".e") == strlen(number.text)) strcat(number.text, ".0");
    return number;
}
