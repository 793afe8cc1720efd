"""Connect blocks: pure delays, blocks one after the other, a delay on every path."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf.delay_lti.blocks import Blocks, beside, blocks_from, from_inputs


def dead(tau: float) -> Blocks:
    """Return the delay of one signal by tau [s]."""
    one = np.ones((1, 1))
    return blocks_from({"Dw": one, "Dv": one, "delays": [tau]}, (0, 1, 1), "dead time")


def delays_of(name: str, given: float | Sequence[float], size: int) -> list[float]:
    """Return one delay [s] for each of `size` signals; `name` : of the argument, in messages."""
    delays = np.asarray(given, dtype=np.float64)
    if delays.ndim == 0:
        delays = np.full(size, delays)
    if delays.shape != (size,):
        raise InputError(
            "the delays do not fit the model",
            where=name,
            expected=f"{size} numbers of seconds",
            got=str(delays.shape),
        )
    return [float(d) for d in delays]


def with_io_delays(blocks: Blocks, given: ArrayLike) -> Blocks:
    """Return the model with a delay from each input to each output: one copy per input."""
    delays = np.asarray(given, dtype=np.float64)
    p, m = blocks.D.shape
    if delays.shape != (p, m):
        raise InputError(
            "the delays do not fit the model",
            where="io_delay",
            expected=f"{p} by {m} numbers of seconds",
            got=str(delays.shape),
        )
    columns = [
        in_series(
            from_inputs(blocks.between(np.eye(p), np.eye(m)[:, [j]])),
            beside(*(dead(d) for d in delays[:, j])),
        )
        for j in range(m)
    ]
    return beside(*columns).between(np.tile(np.eye(p), m), np.eye(m))


def in_series(first: Blocks, following: Blocks) -> Blocks:
    """Return two blocks one after the other; one of a single signal is taken once for each.

    Raises
    ------
    InputError : outputs and inputs that do not fit.
    """
    if first.outputs != following.inputs:
        if following.D.shape == (1, 1):
            following = beside(*[following] * first.outputs)
        elif first.D.shape == (1, 1):
            first = beside(*[first] * following.inputs)
        else:
            raise InputError(
                "models that do not fit in series",
                where="series",
                expected=f"{first.outputs} inputs of what follows",
                got=str(following.inputs),
            )
    F = np.zeros((first.inputs + following.inputs, first.outputs + following.outputs))
    F[first.inputs :, : first.outputs] = np.eye(first.outputs)
    chain = beside(first, following).closed(F)
    left = np.eye(following.outputs, first.outputs + following.outputs, first.outputs)
    return chain.between(left, np.eye(first.inputs + following.inputs, first.inputs)).simplified()
