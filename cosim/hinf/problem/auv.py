"""The vehicle as a system of the form of Eq. (7), with feedback over a link.

Eq. (6) gives no A1, C, E, H for the vehicle; these are this project's choice:

* state x = (eta, nu) about rest on station, A = [[0, I], [0, 0]], u an acceleration, B = [0; I];
* A1 = [[0, 0], [0, -diag(a)]]: an onboard rate-damping loop closed through navigation data
  up to `state_delay` seconds old, of any age: gamma is that of a constant delay, because the
  best Q of that delay tends to 0;
* C = [0; I]: accelerations by waves and current;
* z = (position_weight * eta, u): position error against effort;
* E, H from an operating envelope (`cosim.hinf.problem.envelope`), of any other vehicle than that of
  Table 1 by enclosing its equations (`cosim.hinf.problem.linear_enclosure`);
* the control acts through `loop_delay`: u = K x(t - tau), of any age tau up to it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.problem.envelope import Envelope, auv_uncertainty
from cosim.models import (
    STATE,
    TABLE_1,
    Delay,
    DelaySystem,
    Matrix,
    thrust_map,
    vehicle_derivatives,
)

DEFAULT_ENVELOPE = Envelope(u=0.3, v=0.3, w=0.2, r=0.06, psi=0.35)
"""Slow manoeuvring about a station: a path at 0.1 m/s with a sea on top."""

DEFAULT_K1 = (-0.3, -1.0)
"""k1 for the state delay and the loop delay; gamma is nearly constant around it."""

DEFAULT_K2 = (0.3, 1.0)
"""k2 for the same delays, as insensitive."""


Blocks = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class AuvDesignSettings:
    """Settings for the design of a gain for the vehicle.

    Attributes
    ----------
    state_delay, loop_delay : largest age [s] of the data of the damping loop, and of the
        measurements used by the control; a loop delay of 0 means immediate feedback.
    damping : a of the four velocities [1/s].
    position_weight : weight of eta in z [1/s^2].
    envelope : operating envelope.
    any_age : design for every varying age up to the loop delay (a packet link), not for a
        constant delay.
    parameters : by name, as in Table 1.
    """

    state_delay: float = 0.5
    loop_delay: float = 1.25
    damping: tuple[float, float, float, float] = (0.05, 0.05, 0.05, 0.05)
    position_weight: float = 0.1
    envelope: Envelope = DEFAULT_ENVELOPE
    any_age: bool = True
    parameters: Mapping[str, float] = field(default_factory=lambda: TABLE_1)

    def __post_init__(self) -> None:
        # a negative loop delay would otherwise pass for immediate feedback
        numbers = {
            "state_delay": (self.state_delay,),
            "loop_delay": (self.loop_delay,),
            "damping": self.damping,
            "position_weight": (self.position_weight,),
        }
        for name, values in numbers.items():
            wrong = [value for value in values if not (math.isfinite(value) and value >= 0)]
            if wrong:
                raise InputError(
                    "a setting of the vehicle's design is out of range",
                    where=f"design.{name}",
                    expected="a finite number >= 0",
                    got=repr(wrong[0]),
                )
        if len(self.damping) != 4:
            raise InputError(
                "the damping does not fit the vehicle",
                where="design.damping",
                expected="four numbers, for u, v, w, r",
                got=str(len(self.damping)),
            )


def auv_system(settings: AuvDesignSettings | None = None) -> DelaySystem:
    """Return the vehicle as Eq. (7): n = 8, m = 4, q = 4, p = 8, one delay or two.

        >>> from cosim.hinf import auv_system
        >>> system = auv_system()
        >>> system.A.shape, system.B.shape, [delay.d for delay in system.delays]
        ((8, 8), (8, 4), [0.5, 1.25])

    settings : None: those of `AuvDesignSettings`.
    """
    settings = settings or AuvDesignSettings()
    zero, one = np.zeros((4, 4)), np.eye(4)
    E, H, blocks = _uncertainty(settings)
    damping = np.block([[zero, zero], [zero, -np.diag(settings.damping)]])
    delays = [Delay(settings.state_delay, damping, any_age=True)]
    if settings.loop_delay > 0:
        delays.append(
            Delay(settings.loop_delay, np.zeros((8, 8)), feedback=True, any_age=settings.any_age)
        )
    entry = np.vstack([zero, one])
    return DelaySystem(
        A=np.block([[zero, one], [zero, zero]]),
        B=entry,
        C=entry,
        D=np.block([[settings.position_weight * one, zero], [zero, zero]]),
        D1=np.zeros((8, 4)),
        D2=entry,
        E=E,
        H=H,
        delays=tuple(delays),
        name="auv",
        uncertainty_blocks=blocks,
    )


def _uncertainty(settings: AuvDesignSettings) -> tuple[Matrix, Matrix, Blocks | None]:
    """Return E, H and the blocks of F.

    Those of Table 1 are what published gains are proved for; the free factors in them were found
    for that vehicle. For any other its equations are enclosed, with factors of its own.
    """
    if dict(settings.parameters) == dict(TABLE_1):
        known = auv_uncertainty(settings.envelope, settings.parameters)
        return known.E, known.H, None
    # most runs are of that vehicle: they load no affine arithmetic
    from cosim.hinf.problem.linear_enclosure import Box, enclose  # noqa: PLC0415

    p = {**settings.parameters, **{f"damping.{axis}": 0.0 for axis in "uvwr"}}
    b, bounds = thrust_map(p), settings.envelope

    def equations(x: Sequence[Any], ns: Any) -> list[Any]:
        nothing = [0.0] * 4
        return vehicle_derivatives(x[:8], nothing, nothing, x[16:], p, b, ns)

    sizes = (math.inf, math.inf, math.inf, bounds.psi, *bounds.velocity)
    box = Box(
        names=(*STATE, *(f"{name}(t-d)" for name in STATE), *(f"{x}'" for x in STATE[4:])),
        centre=(0.0,) * 20,
        radius=(*sizes, *[0.0] * 12),
        n=8,
        m=4,
        first=(3,),
        by_norm=((0, 1), (4, 5)),
        weights=(*[settings.position_weight or 1.0] * 4, *[0.0] * 4),
    )
    uncertain = enclose(equations, box).uncertain
    return uncertain.E, uncertain.H[:, :8], uncertain.blocks
