"""Single draws of the streams of `draws`, by the standard library: for components in Python.

The same Philox 4x64-10, keys and logarithm, one number at a time, to the last bit; c/draws.c is
this file in C. An FMU has no NumPy.
"""

from __future__ import annotations

import hashlib
import math

_WORD = 2**64 - 1
_MOST_TURNS = 100_000


def single_uniform(seed: int, name: str, purpose: str, index: int, turn: int = 0) -> float:
    """Return double `index` of a stream: on [0, 1), a multiple of 2**-53."""
    label = f"auv-cosim\0{seed}\0{name}\0{purpose}\0{turn}"
    digest = hashlib.sha256(label.encode()).digest()
    k0, k1 = int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")
    c0, c1, c2, c3 = index // 4 + 1, 0, 0, 0
    for _ in range(10):
        first, second = 0xD2E7470EE14C6C93 * c0, 0xCA5A826395121157 * c2
        c0, c1, c2, c3 = (second >> 64) ^ c1 ^ k0, second & _WORD, (first >> 64) ^ c3 ^ k1, first
        c3 &= _WORD
        k0, k1 = k0 + 0x9E3779B97F4A7C15 & _WORD, k1 + 0xBB67AE8584CAA73B & _WORD
    return float((c0, c1, c2, c3)[index % 4] >> 11) * 2.0**-53


def single_log(x: float) -> float:
    """Return the natural logarithm of x > 0 by basic arithmetic only, as `draws.log`."""
    m, e = math.frexp(x)
    if m < math.sqrt(0.5):
        m, e = 2.0 * m, e - 1
    s = (m - 1.0) / (m + 1.0)
    s2, series = s * s, 0.0
    for k in range(23, 0, -2):
        series = series * s2 + 1.0 / k
    return e * 6.93147180369123816490e-01 + (2.0 * s * series + e * 1.90821492927058770002e-10)


def standard_normal(seed: int, name: str, purpose: str, index: int) -> float:
    """Return number `index` of a stream of independent standard normal numbers.

    Marsaglia's polar method (1964); each round has its own stream, so that no number depends on
    how many rounds the others needed.

    Raises
    ------
    ArithmeticError : no pair was accepted in a great many rounds, each accepts 79 of 100.
    """
    for turn in range(_MOST_TURNS):
        a = single_uniform(seed, name, purpose, 2 * index, turn) * 2.0 - 1.0
        b = single_uniform(seed, name, purpose, 2 * index + 1, turn) * 2.0 - 1.0
        square = a * a + b * b
        if 0.0 < square < 1.0:
            return a * math.sqrt(-2.0 * single_log(square) / square)
    raise ArithmeticError("no normal number was accepted")
