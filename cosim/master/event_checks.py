"""Check what a component says of event mode, Clocks and outputs within steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from cosim.core import InputError
from cosim.fmu import FmuDescription, Port

Ticks = float | Fraction | Sequence[float]
"""The interval of a Clock [s], or the instants of its ticks [s]."""


def check_event_keys(
    description: FmuDescription,
    event_mode: bool | None,  # noqa: FBT001 - as the key of the component
    clocks: Mapping[str, Ticks],
    intermediate: Sequence[str],
) -> None:
    """Check what a component says of event mode, Clocks and outputs within steps.

    Raises
    ------
    InputError : see `Component`.
    """
    file = description.path.name
    if event_mode and not description.has_event_mode:
        raise InputError(
            "this FMU has no event mode",
            where=f"{file}: event_mode",
            expected="FMI 3.0, with hasEventMode in its model description",
        )
    events = description.has_event_mode if event_mode is None else event_mode
    if description.scheduled and not events:
        raise InputError(
            "this FMU does nothing but what its Clocks activate",
            where=f"{file}: event_mode",
            expected="true: it is for scheduled execution",
        )
    for name, ticks in clocks.items():
        port, where = description.port(name, where=f"{file}: clocks"), f"{file}: clocks.{name}"
        if not events or port.clock is None or port.causality != "input":
            raise InputError(
                "only an input Clock of a component in event mode can be given its ticks",
                where=where,
                got=f"{port.causality} {port.getter_type}" + ", no event mode" * (not events),
            )
        _check_ticks(port, ticks, where)
    for name in intermediate:
        port = description.port(name, where=f"{file}: intermediate")
        offered = description.provides_intermediate_update and port.intermediate
        if not offered or port.causality != "output" or port.getter_type != "Float64" or port.shape:
            raise InputError(
                "this variable cannot be read within a step",
                where=f"{file}: intermediate",
                expected="a Float64 output with intermediateUpdate, of an FMU that "
                "providesIntermediateUpdate",
                got=f"{name}: {port.causality} {port.getter_type}"
                + " array" * bool(port.shape)
                + ", not offered" * (not offered),
            )


def _check_ticks(port: Port, ticks: Ticks, where: str) -> None:
    """Check that a Clock may have this interval, or these instants."""
    clock = port.clock
    instants = isinstance(ticks, Sequence)
    if instants and clock is not None and clock.variability != "triggered":
        raise InputError(
            "a time-based Clock ticks by its interval",
            where=where,
            expected="its interval, or nothing where the FMU gives it",
            got="instants",
        )
    if not instants and (clock is None or clock.variability not in ("fixed", "tunable")):
        raise InputError(
            "the interval of this Clock is not the importer's to give",
            where=where,
            expected="a fixed or tunable Clock",
            got="none" if clock is None else f"a {clock.variability} Clock",
        )
    given = list(ticks) if isinstance(ticks, Sequence) else [ticks]
    least = 0 if instants else 1e-9
    if any(not float(one) >= least for one in given) or given != sorted(set(given)):
        raise InputError(
            "these are no ticks of a Clock",
            where=where,
            expected="an interval of at least 1 ns, or instants that increase from 0 or later",
            got=str(ticks),
        )
