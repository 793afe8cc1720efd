"""A second checker of certificates, by Python's standard library alone.

It is for those who doubt the prover: no line is shared with it, and all arithmetic is of
fractions. The folder runs wherever it is copied to: python -m standalone FILE. It says what it
proved, and lists what it did not read: notes, names and sentences.
"""

from .arithmetic import Loop, M, RefusedError, eye, loaded, positive
from .checker import check, not_read
from .damping import damped

__all__ = [
    "Loop",
    "M",
    "RefusedError",
    "check",
    "damped",
    "eye",
    "loaded",
    "not_read",
    "positive",
]
