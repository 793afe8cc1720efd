"""Random numbers that are the same on every machine and with every NumPy.

Philox 4x64-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11) with the
key taken from SHA-256 of seed, link name, purpose and round. Only the raw 64-bit outputs of the
generator are used, which its publication fixes. All arithmetic on them is IEEE addition,
multiplication, division and square root, which round alike everywhere; `log` is written out
here since that of the C library, or of NumPy, differs between machines.

Value k of a stream belongs to message k, so that a longer run begins like a shorter one, and the
messages of a run can be drawn in blocks (from message `first` on).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cosim.network.impairment import GilbertElliott, Jitter, LossChain

_Stream = Callable[[int], NDArray[np.float64]]
"""Returns so many doubles for each message of a block."""

_LN2_HIGH = 6.93147180369123816490e-01  # ln 2 split so that e * _LN2_HIGH is exact
_LN2_LOW = 1.90821492927058770002e-10


def uniform(
    seed: int, name: str, purpose: str, count: int, turn: int = 0, first: int = 0
) -> NDArray[np.float64]:
    """Return doubles `first` to first + count - 1 of a stream: on [0, 1), multiples of 2**-53."""
    label = f"auv-cosim\0{seed}\0{name}\0{purpose}\0{turn}"
    digest = hashlib.sha256(label.encode()).digest()
    generator = np.random.Philox(key=int.from_bytes(digest[:16], "little"))
    generator.advance(first // 4)  # its counter counts blocks of four outputs
    raw = generator.random_raw(first % 4 + count)[first % 4 :]
    scaled: NDArray[np.float64] = (raw >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return scaled


def log(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the natural logarithm of x > 0, to a few ulp, by basic arithmetic only.

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


def jitter_ns(
    jitter: Jitter, seed: int, name: str, count: int, purpose: str = "jitter", first: int = 0
) -> NDArray[np.int64]:
    """Draw the extra delay [ns] of `count` messages; of copies with "copy jitter"."""
    if jitter.kind == "none":
        return np.zeros(count, np.int64)
    if jitter.kind == "uniform":
        u = uniform(seed, name, purpose, count, first=first)
        return np.floor(u * jitter.width_ns).astype(np.int64)
    draw = _exponential if jitter.kind == "exponential" else _normal
    largest = np.inf if jitter.max_ns is None else float(jitter.max_ns)
    extra = np.full(count, -1.0)
    turn = 0
    # Truncation by rejection: each round has its own stream, and message k its place in it, so
    # that the draws of one message do not depend on how many the others needed.
    while (open_ := extra < 0.0).any():

        def stream(each: int, turn: int = turn) -> NDArray[np.float64]:
            return uniform(seed, name, purpose, each * count, turn, each * first)

        value = np.rint(draw(jitter, stream))
        with np.errstate(invalid="ignore"):
            accepted = open_ & (value >= 0.0) & (value <= largest)
        extra[accepted] = value[accepted]
        turn += 1
    return extra.astype(np.int64)


def _exponential(jitter: Jitter, stream: _Stream) -> NDArray[np.float64]:
    """Inverse transform; 1 - u is never 0."""
    return -jitter.mean_ns * log(1.0 - stream(1))


def _normal(jitter: Jitter, stream: _Stream) -> NDArray[np.float64]:
    """Marsaglia's polar method (1964); -1 where the pair falls outside the disc."""
    pairs = stream(2).reshape(-1, 2) * 2.0 - 1.0
    square = pairs[:, 0] * pairs[:, 0] + pairs[:, 1] * pairs[:, 1]
    inside = (square > 0.0) & (square < 1.0)
    safe = np.where(inside, square, 0.5)
    standard = pairs[:, 0] * np.sqrt(-2.0 * log(safe) / safe)
    return np.where(inside, jitter.mean_ns + jitter.sigma_ns * standard, -1.0)


def lost(
    loss: float | GilbertElliott | LossChain | NDArray[np.float64],
    seed: int,
    name: str,
    count: int,
    first: int = 0,
) -> NDArray[np.bool_]:
    """Draw which of `count` messages are lost, with a loss, or with one for each message.

    A chain depends on all messages before: in blocks pass what follows from `states`.
    """
    if isinstance(loss, float) and loss == 0.0:
        return np.zeros(count, np.bool_)
    if isinstance(loss, GilbertElliott | LossChain):
        loss = np.array(loss.losses)[states(loss, seed, name, count)]
    return uniform(seed, name, "loss", count, first=first) < loss


def states(
    chain: GilbertElliott | LossChain,
    seed: int,
    name: str,
    count: int,
    first: int = 0,
    before: int = 0,
) -> NDArray[np.int8]:
    """Draw in which states `count` messages are sent; `before` is that of the last one, int8 (n,).

    A draw maps each state to one: to the first other state that the sum of the probabilities of
    going there exceeds it at, or else to itself. Maps of neighbours are put together in twos,
    fours, ... until each leads to one state wherever it began.
    """
    k = len(chain.losses)
    change = uniform(seed, name, "loss state", count, first=first)
    maps = np.empty((count, k), np.int8)
    for state, moves in enumerate(chain.moves):
        others = [*(other for other in range(k) if other != state), state]
        place = np.searchsorted(np.cumsum(moves), change, side="right")
        maps[:, state] = np.array(others, np.int8)[place]
    if count:  # the first message of all is sent in the first state, whatever was drawn
        maps[0] = maps[0, before] if first > 0 else 0
    width = 1
    while width < count and (maps != maps[:, :1]).any():
        maps[width:] = np.take_along_axis(maps[width:], maps[:-width], axis=1)
        width *= 2
    return maps[:, 0]


def duplicated(
    probability: float, seed: int, name: str, count: int, first: int = 0
) -> NDArray[np.bool_]:
    """Draw which of `count` messages the network copies, if they are not lost."""
    return uniform(seed, name, "duplicate", count, first=first) < probability
