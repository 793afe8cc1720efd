"""The request of an injection, and its start values and provenance."""

from __future__ import annotations

import importlib.metadata
import json
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np

from cosim.core import InputError
from cosim.fmu import FmuDescription
from cosim.replay.input_values import InputValues, Link
from cosim.replay.mapping import SignalMapping, Source
from cosim.replay.trace_attachments import design_in
from cosim.scenario import LoadedScenario, gain_parameters
from cosim.trace import Tolerances, Trace, content_hash

SignalSide = Literal["delivered", "sent"]


@dataclass(frozen=True)
class InjectionRequest:
    """Options of an injection.

        >>> from cosim import DelaySystem, Scenario, inject, run
        >>> from cosim.replay import InjectionRequest
        >>> lag = DelaySystem([[-1]], [[1]])
        >>> two = Scenario(step=0.1, until=1).add("first", lag, initial=[1.0]).add("second", lag)
        >>> result = run(two.connect("first.x", "second.u"), "two.mcap")
        >>> injected = inject("two.mcap", lag, "again.mcap", InjectionRequest(compare="second"))
        >>> injected.status, injected.identical
        ('finished', True)

    Attributes
    ----------
    signal_mapping : recorded signal -> input, and the component that the FMU stands for.
    side : "delivered": the values that receivers had, when they had them. "sent": the values at
        the sender, directly or over `link`; signals without a sender (references) as received.
    link : a new link, or the name of a recorded one, to send over again.
    parameters : of the FMU; they override those of the recorded component.
    step_ns : step of the communication points; None: the instants of the recorded rows.
    compare : the recorded component to compare the outputs with.
    """

    signal_mapping: SignalMapping = field(default_factory=SignalMapping)
    side: SignalSide = "delivered"
    link: Link | str | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    step_ns: int | None = None
    compare: str | None = None
    tolerances: Tolerances = field(default_factory=Tolerances)


def start_values(
    trace: Trace,
    fmu: FmuDescription,
    request: InjectionRequest,
    role: str | None,
    scenario: LoadedScenario | None,
) -> tuple[dict[str, Any], list[str]]:
    """Return the parameters to set, and recorded ones that this FMU does not have.

    Recorded parameters apply to the recorded FMU, or if `role` was requested; another controller
    keeps its own.
    """
    found: dict[str, Any] = {}
    ran = trace.run.get(f"fmu.{role}.sha256") == fmu.sha256
    wanted = ran or request.signal_mapping.role is not None
    if role is not None and scenario is not None and wanted:
        component = scenario.scenario.components.get(role)
        if component is not None:
            found = dict(component.parameters)
        design = scenario.scenario.design
        if design is not None and design.controller == role:
            found |= _gain(design_in(trace)["K"], fmu)
    settable = ("parameter", "structuralParameter", "input")
    known = {port.name for port in fmu.ports.values() if port.causality in settable}
    there = {name: value for name, value in found.items() if name in known}
    return {**there, **request.parameters}, [name for name in found if name not in there]


def _gain(K: Any, fmu: FmuDescription) -> dict[str, float]:
    try:
        return gain_parameters(K, fmu)
    except InputError:  # a controller of another kind: its own entries of K do not fit
        rows = np.asarray(K, dtype=float)
        return {f"K[{i + 1},{j + 1}]": float(v) for (i, j), v in np.ndenumerate(rows)}


def provenance(
    trace: Trace,
    fmu: FmuDescription,
    name: str,
    request: InjectionRequest,
    link: Link | None,
    sources: Mapping[str, Source],
    parameters: Mapping[str, Any],
    input_values: InputValues,
) -> dict[str, str]:
    """Return the entries of `cosim.run`."""
    entries = {
        "software": f"auv-cosim {importlib.metadata.version('auv-cosim')}",
        "title": f"{name}, fed what was {request.side} in {trace.path.name}",
        "injected.from": trace.path.name,
        "injected.content_hash": content_hash(trace.path),
        "injected.content_hash_version": str(trace.content_hash_version),
        "injected.as": request.side,
        "injected.shift_ns": str(input_values.shift_ns),
        "end_ns": str(int(input_values.points_ns[-1])),
        "time_base": "simulated nanoseconds from the first recorded row",
        f"fmu.{name}": fmu.path.name,
        f"fmu.{name}.sha256": fmu.sha256,
        "parameters": json.dumps(dict(parameters), sort_keys=True),
        "host.python": platform.python_version(),
        "host.platform": platform.platform(),
        "host.started": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    if request.step_ns is not None:
        entries["step_ns"] = str(request.step_ns)
    if link is not None:
        entries["injected.link"] = json.dumps(asdict(link), sort_keys=True)
    for target, source in sources.items():
        entries[f"injected.map.{target}"] = f"{source.topic}:{source.column}"
    if "scenario" in trace.run:
        entries["injected.scenario"] = trace.run["scenario"]
    return entries
