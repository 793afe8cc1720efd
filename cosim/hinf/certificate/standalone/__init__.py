"""A second checker of certificates, by Python's standard library alone.

It is for those who doubt the prover: no line is shared with it, and all arithmetic is of
fractions. The folder runs wherever it is copied to: python -m standalone FILE. It says what it
proved, and lists what it did not read: notes, names and sentences.
"""

from .arithmetic import (
    Loop as Loop,
    M as M,
    RefusedError as RefusedError,
    eye as eye,
    loaded as loaded,
    positive as positive,
)
from .checker import check as check, not_read as not_read
from .damping import damped as damped
