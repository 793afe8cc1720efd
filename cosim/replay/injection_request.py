"""What is asked of an injection, and what follows from it: start values, provenance."""

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
    """What is asked for.

    Attributes
    ----------
    signal_mapping : which signals go where, and whose part the FMU plays.
    side : "delivered": what receivers had, when they had it. "sent": what senders sent, at once
        or over `link`; what nobody sent (references) stays as it was received.
    link : a new link, or the name of a recorded one, to send over again.
    parameters : of the FMU, on top of those that the recorded component flew with.
    step_ns : step of the communication points; None: the instants of the recorded rows.
    compare : the recorded component whose outputs the new ones are compared with.
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
    """Parameters to set, and those of the recorded component that this FMU does not have.

    The recorded ones are taken for the FMU that flew, and where its part is named; another
    controller comes with its own.
    """
    found: dict[str, Any] = {}
    ran = role is not None and trace.run.get(f"fmu.{role}.sha256") == fmu.sha256
    if (
        role is not None
        and scenario is not None
        and (ran or request.signal_mapping.role is not None)
    ):
        component = scenario.scenario.components.get(role)
        if component is not None:
            found = dict(component.parameters)
        design = scenario.scenario.design
        if design is not None and design.controller == role:
            found |= _gain(design_in(trace)["K"], fmu)
    there = {name: value for name, value in found.items() if _settable(fmu, name)}
    return {**there, **request.parameters}, [name for name in found if name not in there]


def _gain(K: Any, fmu: FmuDescription) -> dict[str, float]:
    try:
        return gain_parameters(K, fmu)
    except InputError:  # a controller of another kind has another gain
        rows = np.asarray(K, dtype=float)
        return {f"K[{i + 1},{j + 1}]": float(v) for (i, j), v in np.ndenumerate(rows)}


def _settable(fmu: FmuDescription, name: str) -> bool:
    port = fmu.ports.get(name)
    return port is not None and port.causality in ("parameter", "structuralParameter", "input")


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
    """Entries of `cosim.run`."""
    entries = {
        "software": f"auv-cosim {importlib.metadata.version('auv-cosim')}",
        "title": f"{name}, fed what was {request.side} in {trace.path.name}",
        "injected.from": trace.path.name,
        "injected.content_hash": content_hash(trace.path),
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
