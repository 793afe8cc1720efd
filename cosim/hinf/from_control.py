"""To and from python-control: what its tools can take of a loop with delays.

A `control.ss` has no delays, so a loop goes there as its frequency response, which is exact at
every frequency it is asked for; `DelaySystem.from_state_space` is the way in.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.hinf.closed_loop import ClosedLoop
from cosim.models import DelaySystem


def frequency_response(loop: ClosedLoop, omega: ArrayLike) -> NDArray[np.complex128]:
    """The gain from w to z, (p, q, len(omega)): D(s) (s I - A(s))^-1 C + D1 at s = j omega.

    Parameters
    ----------
    loop : a loop with w and z, see `close`.
    omega : frequencies [rad/s].

    Raises
    ------
    InputError : a loop without w or z, frequencies that are none, or one at a root of the loop.
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
    """The frequency response of a loop as python-control's `control.FRD`.

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
    """`system`, if it is a `DelaySystem`; with `control`, one that a gain can be designed for.

    Raises
    ------
    InputError : it is something else (the message says how to make one of it), or has no B.
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
