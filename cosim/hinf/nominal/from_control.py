"""Loops with delays for python-control, as frequency responses.

A `control.ss` has no delays; a frequency response is exact at each of its frequencies. The other
direction is `DelaySystem.from_state_space`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.hinf.nominal.closed_loop import ClosedLoop
from cosim.models import DelaySystem


def frequency_response(loop: ClosedLoop, omega: ArrayLike) -> NDArray[np.complex128]:
    """Return G(j omega) from w to z, (p, q, len(omega)): D(s) (s I - A(s))^-1 C + D1.

    Parameters
    ----------
    loop : a loop with w and z, see `close`.
    omega : frequencies [rad/s].

    Raises
    ------
    InputError : a loop without w or z, omega not finite, or at a root of the loop.
    """
    try:
        points = np.asarray(omega, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise InputError("not frequencies", where="omega", expected="numbers of rad/s") from error
    if not np.isfinite(points).all():
        raise InputError("not frequencies", where="omega", expected="finite numbers of rad/s")
    try:
        return np.moveaxis(loop.transfer(points), 0, -1)
    except np.linalg.LinAlgError as error:
        raise InputError("a frequency at which the loop has a root", where="omega") from error


def to_control(loop: ClosedLoop, omega: ArrayLike) -> Any:
    """Return the frequency response of a loop as python-control's `control.FRD`.

    Raises
    ------
    InputError : python-control is not installed; else as `frequency_response`.
    """
    try:
        import control  # noqa: PLC0415 - an extra that few need
    except ImportError as error:
        raise InputError(
            "python-control is not installed",
            where="control",
            hint='pip install "auv-cosim[control]"',
        ) from error
    points = np.asarray(omega, dtype=np.float64).ravel()
    return control.FRD(frequency_response(loop, points), points)


def checked_system(system: Any, *, control: bool = False) -> DelaySystem:
    """Return `system` if it is a `DelaySystem`, with `control` only if it has a B.

    Raises
    ------
    InputError : it is something else (the message says how to convert it), or has no B.
    """
    if isinstance(system, DelaySystem):
        n, m = system.B.shape
        if control and not m:
            raise InputError(
                "there is no gain to design: the system has no control, B is missing",
                where=f"{system.name}: B" if system.name else "B",
                expected=f"B, {n} rows with one column per control",
                got="no B",
                hint="give B beside A, or analyse the system as it is (cosim analyse)",
            )
        return system
    is_plant = all(hasattr(system, name) for name in "ABCD")
    raise InputError(
        "not a system with delays",
        where="system",
        expected="a DelaySystem",
        got=type(system).__name__,
        hint="DelaySystem.from_state_space(plant, ncon=..., delays=[...])" if is_plant else None,
    )
