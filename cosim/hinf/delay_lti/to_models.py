"""Blocks for other libraries: with delays as exact data, or rational with Pade approximants.

The Pade approximant of order n is realised in balanced units, one block per delay: a chain of
high order has no polynomial whose coefficients would swamp each other.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError, optional
from cosim.hinf.delay_lti.blocks import Blocks, beside
from cosim.hinf.delay_lti.closed_loop import ClosedLoop
from cosim.hinf.delay_lti.frequency import frequency_response
from cosim.hinf.delay_lti.from_models import blocks_of


def rational(blocks: Blocks, order: int | None) -> Blocks:
    """Return the blocks with every delay replaced by its Pade approximant of this order.

    Raises
    ------
    InputError : delays, and no order.
    """
    N = blocks.delays.size
    if not N:
        return blocks
    if order is None or order < 1:
        raise InputError(
            "a rational model has no delays",
            where="pade",
            expected="the order of a Pade approximant, >= 1",
            got="none" if order is None else str(order),
            hint="or a frequency response, which is exact: to_control(omega=...)",
        )
    m, p = blocks.inputs, blocks.outputs
    opened = Blocks(
        A=blocks.A,
        B=np.hstack([blocks.B, blocks.Bw]),
        C=np.vstack([blocks.C, blocks.Cv]),
        D=np.block([[blocks.D, blocks.Dw], [blocks.Dv, blocks.Dvw]]),
        Bw=np.zeros((blocks.order, 0)),
        Dw=np.zeros((p + N, 0)),
        Cv=np.zeros((0, blocks.order)),
        Dv=np.zeros((0, m + N)),
        Dvw=np.zeros((0, 0)),
        delays=np.zeros(0),
    )
    joined = beside(opened, *(_pade(tau, order) for tau in blocks.delays.tolist()))
    F = np.zeros((joined.inputs, joined.outputs))
    F[m : m + N, p + N :] = np.eye(N)  # w from the approximants
    F[m + N :, p : p + N] = np.eye(N)  # v into them
    return joined.closed(F).between(np.eye(p, joined.outputs), np.eye(joined.inputs, m))


def _pade(tau: float, order: int) -> Blocks:
    """Return the approximant of e^{-s tau}, numerator and denominator of degree `order`."""
    k = range(order + 1)
    c = [
        math.factorial(2 * order - i) * math.comb(order, i) / math.factorial(2 * order) * tau**i
        for i in k
    ]
    bottom = np.array(c[::-1])
    top = np.array([(-1) ** i * c[i] for i in k][::-1])

    class Model:
        num, den = top, bottom

    return blocks_of(Model())


def control_module() -> Any:
    """Import python-control; `InputError` if it is not installed."""
    return optional("control", extra="control", what="models for python-control need it")


def to_control(loop: ClosedLoop | Blocks, omega: ArrayLike) -> Any:
    """Return the frequency response of a loop as python-control's `control.FRD`.

    Raises
    ------
    InputError : python-control is not installed; else as `frequency_response`.
    """
    control = control_module()
    points = np.asarray(omega, dtype=np.float64).ravel()
    return control.FRD(frequency_response(loop, points), points)


def state_space_for_control(blocks: Blocks, order: int | None) -> Any:
    """Return a `control.StateSpace`."""
    model = rational(blocks, order)
    return control_module().ss(model.A, model.B, model.C, model.D)


def state_space_for_scipy(blocks: Blocks, order: int | None) -> Any:
    """Return a `scipy.signal.StateSpace`."""
    import scipy.signal  # noqa: PLC0415 - slow to import

    model = rational(blocks, order)
    return scipy.signal.StateSpace(model.A, model.B, model.C, model.D)
