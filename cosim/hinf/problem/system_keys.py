"""The keys of a system file, declared once: for its reader, for messages, for the documentation.

Each table has its keys in the order in which they are explained, with the kind of value and what
the key means. The symbols are those of Eq. (7).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Key(NamedTuple):
    """A key of a system file: the value it takes, what it means, whether the table needs it."""

    value: str
    text: str
    required: bool = False


_ONE_DELAY = {
    "A1": Key("matrix, n rows and columns", "Of x(t-d), where there is one constant delay."),
    "H1": Key("matrix, n columns", "Right factor of the uncertainty of A1."),
    "d": Key("number [s]", "The one delay; with A1 or H1."),
}

SYSTEM: Mapping[str, Key] = {
    "name": Key("text", "Name of the system; without it that of the file."),
    "A": Key("matrix, n rows and columns", "Of x(t).", required=True),
    "B": Key("matrix, n rows", "Of the control u."),
    "C": Key("matrix, n rows", "Of the disturbance w."),
    "D": Key("matrix, n columns", "z = D x + D1 w + D2 u, what is to be kept small."),
    "D1": Key("matrix, as many rows as D", "Of w in z."),
    "D2": Key("matrix, as many rows as D", "Of u in z."),
    "E": Key("matrix, n rows", "Left factor of the uncertainty E F(t) [H, H1], F'F <= I."),
    "H": Key("matrix, n columns", "Right factor of the uncertainty of A."),
    **_ONE_DELAY,
    "delays": Key("tables", "Any number of delays, [[system.delays]], in place of A1, H1, d."),
    "uncertainty_blocks": Key(
        "pairs of whole numbers",
        "Columns of E and rows of H of each block of F; [1, 1] is a parameter.",
    ),
    "weights": Key("numbers > 0", "One for each row of z, which is multiplied by it."),
    "feedback": Key(
        "truth values",
        "One for each state: whether it is fed back at once. Without it every state is, unless a "
        "delay is marked feedback; a state that is fed back nowhere is not measured.",
    ),
    "integral": Key("table", "Integral action of the controller, [system.integral]."),
}

DELAY: Mapping[str, Key] = {
    "d": Key("number [s]", "The delay, or the greatest age.", required=True),
    "A": Key("matrix, n rows and columns", "Of x(t-d); without it zero."),
    "H": Key("matrix, n columns", "Right factor of the uncertainty of this A."),
    "feedback": Key(
        "true, or truth values",
        "The control acts through this delay, u = K x(t-d); or one value for each state.",
    ),
    "any_age": Key(
        "true or false",
        "Every age from 0 to d, however it varies, in place of the constant d. Feedback that is "
        "held between messages or steps has no constant age.",
    ),
    "least_age": Key("number [s]", "The age is never less than this."),
    "rate": Key("number", "The age is continuous, and changes no faster than this."),
    "sampled": Key(
        "true or false",
        "The age is least_age when a sample comes into use, grows at rate one, and is at most d "
        "when the next one does.",
    ),
}

INTEGRAL: Mapping[str, Key] = {
    "of": Key(
        "whole numbers, or rows",
        "States that are integrated, from 1, or rows of their combinations.",
        required=True,
    ),
    "weights": Key(
        "numbers > 0", "Of the integrals in z; without them 0.1/d times those of the states."
    ),
    "age": Key("number [s]", "Greatest age of an integral where it acts; 0: at once."),
}

FILTER: Mapping[str, Key] = {
    "A": Key("matrix", "x_f' = A x_f + B v, stable."),
    "B": Key("matrix", "Of the input v of the filter."),
    "C": Key("matrix", "The output is C x_f + D v."),
    "D": Key("matrix", "Of v in the output; without it zero."),
    "numerators": Key(
        "lists of numbers",
        "In place of A, B, C, D: a transfer function for each entry, by falling powers of s.",
    ),
    "denominators": Key("lists of numbers", "One for each numerator."),
}

DESIGN: Mapping[str, Key] = {
    "k1": Key("number, or numbers", "Scalars k1 of Theorem 2, one per delay; else searched."),
    "k2": Key("number, or numbers", "Scalars k2, one per delay, not zero; else searched."),
    "gamma": Key("number > 0", "Gain from w to z to be met; without it the least."),
    "decay": Key("number [1/s]", "Least rate at which every solution with w = 0 decays."),
    "damping": Key(
        "number from 0 to 1", "Least damping ratio of the nominal loop's roots s; with within."
    ),
    "within": Key("number [1/s]", "Damping is for the roots with Re s >= -within."),
    "gain_limit": Key("number", "Bound on |K|, the largest singular value."),
    "peak_control": Key(
        "number, or numbers", "Bounds on every |u_i(t)|, for offset and energy; one, or one each."
    ),
    "offset": Key("numbers", "Bounds on the initial state |x_i(0)|, constant before."),
    "energy": Key("number", "Bound on the square root of the integral of w'w."),
}

MEASUREMENT: Mapping[str, Key] = {
    "name": Key("text", "Name of the sensor.", required=True),
    "states": Key("whole numbers", "The states it measures, from 1; or C."),
    "C": Key("matrix, n columns", "y = C x + v, in place of states."),
    "d": Key("number [s]", "Greatest age at the end of its use; without it 0: at once."),
    "any_age": Key(
        "true or false",
        "Every age from 0 to d, however it varies; without it true. False: the constant d, which "
        "nothing has that is held between messages.",
    ),
    "least_age": DELAY["least_age"],
    "rate": DELAY["rate"],
    "sampled": DELAY["sampled"],
    "noise": Key("number, or numbers", "Size of v, one for each row; weighed in like w."),
    "over": Key("link or onboard", "How it reaches the observer; without it link."),
}

OBSERVER: Mapping[str, Key] = {
    "known": Key(
        "whole numbers",
        "States, from 1, that only u and known states act on, as on a thruster's lag.",
    ),
    "command_age": Key(
        "number [s]",
        "Greatest age of a command, from the estimate to the end of its use: the longest hold and "
        "a step; 0: at once, which no run can show. Without it the greatest of some ages, half the "
        "least of a measurement at most, that makes gamma less than a quarter greater.",
    ),
    "command_any_age": Key(
        "true or false",
        "Every age from 0 to command_age; without it true. False: the constant one, which nothing "
        "has that is held between steps.",
    ),
    "K": Key("matrix, n columns", "u = K xh, where it is not to be designed."),
    "L": Key("matrices by name", "L of every measurement, where it is not to be designed."),
    "offset": Key(
        "numbers >= 0",
        "Prove peaks of u and x from |x_i(0)| at most this, one for each state.",
    ),
    "initial_error": Key(
        "numbers >= 0", "Of the estimate; without it that starts at zero, and the error is x."
    ),
    "energy": Key("number", "Of w and noise of these peaks: square root of the integral of w'w."),
}

SYSTEM_TABLES: Mapping[str, tuple[str, Mapping[str, Key]]] = {
    "[system]": ("Matrices of Eq. (7); a matrix is a list of rows.", SYSTEM),
    "[[system.delays]]": ("One delay each, with what is known of its age.", DELAY),
    "[system.integral]": ("Integral action on what the controller receives.", INTEGRAL),
    "[weights.z], [weights.w]": (
        "Weights that depend on frequency, of z and w: as matrices, or as transfer functions.",
        FILTER,
    ),
    "[[measurements]]": (
        "A sensor. All states, whole, without noise, are fed back; else an observer is designed.",
        MEASUREMENT,
    ),
    "[observer]": ("An observer of the measurements, also where none is needed.", OBSERVER),
    "[design]": ("Settings and constraints of a design; none is needed.", DESIGN),
}
"""The tables of a system file: heading, what a table is for, and its keys."""
