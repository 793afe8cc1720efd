/* Messages in words, with numbers in the fewest digits that name them. */

#ifndef MESSAGE_H
#define MESSAGE_H

typedef struct {
    char text[512];
} Message;

typedef struct {
    char text[40];
} Number;

/* Fill the message; returns 0, so that a refusal is `return say(...)`. */
int say(Message *message, const char *format, ...);

/* The shortest decimal that reads back as x, as Python's repr writes it. */
Number shortest(double x);

#endif
