"""Random numbers that are the same on every machine and with every NumPy.

Philox 4x64-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11) with the
key taken from SHA-256 of seed, link name, purpose and round: nothing but the raw 64-bit
outputs of the generator is used, whose stream is fixed by its publication. Everything after
it is IEEE addition, multiplication, division and square root, which round alike everywhere;
`log` is written out here since that of the C library, or of NumPy, is not the same from one
machine to the next.

Value k of a stream belongs to message k. A longer run thus begins with the shorter one.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cosim.network.packet import GilbertElliott, Jitter

_LN2_HIGH = 6.93147180369123816490e-01  # ln 2 split so that e * _LN2_HIGH is exact
_LN2_LOW = 1.90821492927058770002e-10


def uniform(seed: int, name: str, purpose: str, count: int, turn: int = 0) -> NDArray[np.float64]:
    """`count` doubles on [0, 1), multiples of 2**-53, of the stream so named."""
    label = f"auv-cosim\0{seed}\0{name}\0{purpose}\0{turn}"
    digest = hashlib.sha256(label.encode()).digest()
    raw = np.random.Philox(key=int.from_bytes(digest[:16], "little")).random_raw(count)
    scaled: NDArray[np.float64] = (raw >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return scaled


def log(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Natural logarithm of x > 0, to a few ulp, in basic arithmetic only.

    x = 2**e m with m in [sqrt(1/2), sqrt(2)); log m = 2 atanh(s), s = (m - 1) / (m + 1),
    |s| < 0.1716, whose series is cut where s**24 < 1e-18.
    """
    m, e = np.frexp(x)
    low = m < np.sqrt(0.5)
    m = np.where(low, 2.0 * m, m)
    e = e - low
    s = (m - 1.0) / (m + 1.0)
    s2 = s * s
    series = np.zeros_like(s)
    for k in range(23, 0, -2):
        series = series * s2 + 1.0 / k
    result: NDArray[np.float64] = e * _LN2_HIGH + (2.0 * s * series + e * _LN2_LOW)
    return result


def jitter_ns(jitter: Jitter, seed: int, name: str, count: int) -> NDArray[np.int64]:
    """Extra delay of messages 0 to count - 1 [ns]."""
    if jitter.kind == "none":
        return np.zeros(count, np.int64)
    if jitter.kind == "uniform":
        u = uniform(seed, name, "jitter", count)
        return np.floor(u * jitter.width_ns).astype(np.int64)
    draw = _exponential if jitter.kind == "exponential" else _normal
    largest = np.inf if jitter.max_ns is None else float(jitter.max_ns)
    extra = np.full(count, -1.0)
    turn = 0
    # Truncation by refusal: each round has its own stream, and message k its place in it, so
    # that the draws of one message do not depend on how many the others needed.
    while (open_ := extra < 0.0).any():
        value = np.rint(draw(jitter, seed, name, count, turn))
        with np.errstate(invalid="ignore"):
            accepted = open_ & (value >= 0.0) & (value <= largest)
        extra[accepted] = value[accepted]
        turn += 1
    return extra.astype(np.int64)


def _exponential(
    jitter: Jitter, seed: int, name: str, count: int, turn: int
) -> NDArray[np.float64]:
    """Inverse transform; 1 - u is never 0."""
    return -jitter.mean_ns * log(1.0 - uniform(seed, name, "jitter", count, turn))


def _normal(jitter: Jitter, seed: int, name: str, count: int, turn: int) -> NDArray[np.float64]:
    """Marsaglia's polar method (1964); -1 where the pair falls outside the disc."""
    pairs = uniform(seed, name, "jitter", 2 * count, turn).reshape(count, 2) * 2.0 - 1.0
    square = pairs[:, 0] * pairs[:, 0] + pairs[:, 1] * pairs[:, 1]
    inside = (square > 0.0) & (square < 1.0)
    safe = np.where(inside, square, 0.5)
    standard = pairs[:, 0] * np.sqrt(-2.0 * log(safe) / safe)
    return np.where(inside, jitter.mean_ns + jitter.sigma_ns * standard, -1.0)


def lost(loss: float | GilbertElliott, seed: int, name: str, count: int) -> NDArray[np.bool_]:
    """Which of messages 0 to count - 1 are lost."""
    u = uniform(seed, name, "loss", count)
    if isinstance(loss, (int, float)):
        return u < loss
    change = uniform(seed, name, "loss state", count)
    bad = False
    result = np.zeros(count, np.bool_)
    for k in range(count):
        if k > 0:
            bad = change[k] >= loss.p_exit if bad else change[k] < loss.p_enter
        result[k] = u[k] < (loss.loss_bad if bad else loss.loss_good)
    return result
