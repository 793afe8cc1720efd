"""Whether this process computes as it did when it began: what foreign code may have changed."""

from __future__ import annotations

import ctypes
import sys

_ONE, _TEN, _TINY = 1.0, 10.0, 5e-324
_strtod = ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).strtod
_strtod.restype = ctypes.c_double


def is_usual() -> bool:
    """Whether numbers are rounded and read to nearest, and tiny numbers kept."""
    return rounds_to_nearest() and reads_to_nearest() and keeps_tiny_numbers()


def rounds_to_nearest() -> bool:
    """Whether the quotient 0.1 is rounded to nearest: upwards."""
    return (_ONE / _TEN).hex() == "0x1.999999999999ap-4"


def reads_to_nearest() -> bool:
    """Whether C reads 0.1 so: on x86 its library asks the x87 unit, which little else uses."""
    return float(_strtod(b"0.1", None)).hex() == "0x1.999999999999ap-4"


def keeps_tiny_numbers() -> bool:
    """Whether they are not counted as zero."""
    return _TINY * _TEN > 0.0
