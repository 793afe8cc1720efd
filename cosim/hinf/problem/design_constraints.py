"""Design constraints beside gamma: a rate of decay, damping, a bound on |K|, peaks of u."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cosim.core import InputError, counted
from cosim.hinf.certificate import (
    MAX_OFFSETS,
    Damping,
    checked_damping,
    growth_of,
    too_many_offsets,
)
from cosim.hinf.exact import exact
from cosim.models import DelaySystem

KEYS = ("decay", "damping", "within", "gain_limit", "peak_control", "offset", "energy")


@dataclass(frozen=True)
class DesignConstraints:
    """The constraints that a gain must meet beside gamma; None: no such constraint.

        >>> from pathlib import Path
        >>> from cosim.hinf import DesignConstraints, system_by_name
        >>> size = Path("drift.toml").write_text('''
        ... [system]
        ... A = [[0.1]]
        ... B = [[1]]
        ... [design]
        ... decay = 0.5
        ... ''')
        >>> system_by_name("drift.toml").design_constraints == DesignConstraints(decay=0.5)
        True

    decay : least rate [1/s] at which every solution decays.
    damping : least damping ratio, between 0 and 1, of every root s of the nominal loop with
        Re s >= -within.
    within : how far to the left roots count [1/s].
    gain_limit : bound on the largest singular value of K.
    peak_control : bound on |u_i(t)|, one number per input, for every initial state of the box
        and every disturbance of the energy below.
    offset : the box, one number per state: |x_i| <= offset_i, constant before t = 0.
    energy : int w'w <= energy^2.
    """

    decay: float | None = None
    gain_limit: float | None = None
    peak_control: tuple[float, ...] | None = None
    offset: tuple[float, ...] | None = None
    energy: float | None = None
    damping: float | None = None
    within: float | None = None

    @property
    def any(self) -> bool:
        """Whether there is any constraint."""
        return self != DesignConstraints()

    @property
    def damping_to_prove(self) -> Damping | None:
        """The damping as the claim that a proof decides; None without one."""
        if self.damping is None or self.within is None:
            return None
        return Damping(exact(self.damping), exact(self.within))


def design_constraints_of(
    system: DelaySystem,
    *,
    decay: float | None = None,
    gain_limit: float | None = None,
    peak_control: Sequence[float] | float | None = None,
    offset: Sequence[float] | None = None,
    energy: float | None = None,
    damping: float | None = None,
    within: float | None = None,
    where: str = "",
) -> DesignConstraints:
    """Check constraints against a system; one number for `peak_control` applies to every input.

    Raises
    ------
    InputError : a number out of range, a length that does not fit, a peak of u without an
        offset and an energy, damping without `within` or with a sampled age.
    """
    prefix = f"{where}." if where else ""
    if decay is not None:
        growth_of(system, decay)
    checked_damping(system, damping, within, prefix)
    if gain_limit is not None:
        _positive(gain_limit, f"{prefix}gain_limit")
    if peak_control is not None:
        values = [peak_control] if isinstance(peak_control, int | float) else list(peak_control)
        peaks = _peaks(system, values, f"{prefix}peak_control")
        box, strength = _start(system, offset, energy, prefix)
        return DesignConstraints(decay, gain_limit, peaks, box, strength, damping, within)
    for name, value in (("offset", offset), ("energy", energy)):
        if value is not None:
            raise InputError(
                f"{name} is only used with a limit on the peak of the control",
                where=f"{prefix}{name}",
                expected="peak_control as well",
            )
    return DesignConstraints(decay, gain_limit, damping=damping, within=within)


def _peaks(system: DelaySystem, values: Sequence[float], where: str) -> tuple[float, ...]:
    """Return one limit per input."""
    m = system.B.shape[1]
    peaks = tuple(float(value) for value in (list(values) * m if len(values) == 1 else values))
    if len(peaks) != m or m == 0:
        raise InputError(
            "peak_control does not fit the system",
            where=where,
            expected=f"one number, or {m} of them, one per input" if m else "a system with inputs",
            got=f"{len(values)} of them",
        )
    for i, value in enumerate(peaks):
        _positive(value, f"{where}[{i}]")
    return peaks


def _start(
    system: DelaySystem, offset: Sequence[float] | None, energy: float | None, prefix: str
) -> tuple[tuple[float, ...], float]:
    """Return the box of initial states, and the energy of the disturbance."""
    n = system.A.shape[0]
    box = tuple(float(value) for value in offset) if offset is not None else (0.0,) * n
    if len(box) != n:
        raise InputError(
            "the offset does not fit the system",
            where=f"{prefix}offset",
            expected=f"{counted(n, 'number')}, one per state",
            got=f"{len(box)} of them",
        )
    for i, value in enumerate(box):
        _not_negative(value, f"{prefix}offset[{i}]")
    sides = sum(value > 0 for value in box)
    if sides > MAX_OFFSETS:
        raise too_many_offsets(sides, f"{prefix}offset")
    strength = 0.0 if energy is None else float(energy)
    _not_negative(strength, f"{prefix}energy")
    if strength and not system.C.size:
        raise InputError(
            "this system has no disturbance",
            where=f"{prefix}energy",
            expected="0, or a system with C",
        )
    if not strength and not any(box):
        raise InputError(
            "a peak of the control cannot arise from nothing: no offset and no energy",
            where=f"{prefix}peak_control",
            expected="an offset of the initial state, an energy of the disturbance, or both",
            hint="give offset, one number per state, or energy",
        )
    return box, strength


def _positive(value: float, where: str) -> None:
    if not (math.isfinite(value) and value > 0):
        raise InputError("not a limit", where=where, expected="a positive number", got=repr(value))


def _not_negative(value: float, where: str) -> None:
    if not (math.isfinite(value) and value >= 0):
        raise InputError("out of range", where=where, expected="a number >= 0", got=repr(value))
