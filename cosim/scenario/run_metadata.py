"""Metadata and attachments of a trace, with which it can be run and proved again."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict, fields, is_dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim import hinf
from cosim.master import CommunicationSchedule, Link, System, receiving_order
from cosim.network import DelayProfile, Hop, PacketLink, Recording, keys_of
from cosim.scenario.gain import starts_with
from cosim.scenario.preparation import PreparedScenario
from cosim.trace import Attachment
from cosim.trace.rows import (
    CERTIFICATE_ATTACHMENT,
    DESIGN_ATTACHMENT,
    SCENARIO_ATTACHMENT,
    certificate_entries,
)

if TYPE_CHECKING:
    from cosim.hinf import Result


def run_metadata_of(
    prepared: PreparedScenario, system: System
) -> tuple[dict[str, str], Sequence[Attachment]]:
    """Return the entries of `cosim.run`, and the attachments."""
    loaded = prepared.loaded
    text = loaded.text.encode()
    attachments = [Attachment(SCENARIO_ATTACHMENT, "application/toml", text)]
    entries = {
        "software": f"auv-cosim {importlib.metadata.version('auv-cosim')}",
        "scenario": loaded.name,
        "title": loaded.scenario.title,
        "scenario.sha256": hashlib.sha256(text).hexdigest(),
        "step_ns": str(system.comm_schedule.step_ns),
        **_times(system.comm_schedule),
        "events": loaded.scenario.run.events,
        "seed": str(loaded.scenario.run.seed),
        "host.python": platform.python_version(),
        "host.platform": platform.platform(),
        "host.started": datetime.now(UTC).isoformat(timespec="seconds"),
        "host.command": " ".join(Path(a).name if i == 0 else a for i, a in enumerate(sys.argv)),
    }
    if loaded.source_sha256 is not None:
        entries["host.scenario.source.sha256"] = loaded.source_sha256
    for package in ("fmpy", "pythonfmu", "numpy", "mcap"):
        entries[f"host.{package}"] = importlib.metadata.version(package)
    with_events = [name for name, component in system.components.items() if component.has_events]
    if with_events:
        entries["event_mode"] = ", ".join(with_events)
    cut = receiving_order(system).cut
    if cut:
        pairs = [{"from": str(c.source), "to": str(c.target)} for c in cut]
        entries["cut_connections"] = json.dumps(pairs, sort_keys=True)
    if prepared.worst_case is not None:
        entries["disturbance"] = json.dumps(asdict(prepared.worst_case), sort_keys=True)
    for name, link in system.links.items():
        entries[f"link.{name}"] = json.dumps(_link_entry(link), sort_keys=True)
        entries |= _medium_entry(link)
    for name, fmu in prepared.fmus.items():
        entries[f"fmu.{name}"] = loaded.scenario.components[name].fmu
        entries[f"fmu.{name}.sha256"] = fmu.sha256
        attachments.append(Attachment(f"{name}.modelDescription.xml", "text/xml", fmu.xml))
    if prepared.design is not None:
        data = json.dumps(prepared.design.to_json(), allow_nan=False).encode()
        entries["design.sha256"] = hashlib.sha256(data).hexdigest()
        attachments.append(Attachment(DESIGN_ATTACHMENT, "application/json", data))
        named, proof = _certificate(prepared, prepared.design)
        entries |= named
        attachments.append(proof)
    return entries, attachments


def _times(schedule: CommunicationSchedule) -> dict[str, str]:
    """Return when the run begins, if not at 0, and ends, and what its times are."""
    if not schedule.start_ns:
        base = "simulated nanoseconds from the start of the run"
        return {"end_ns": str(schedule.end_ns), "time_base": base}
    return {
        "start_ns": str(schedule.start_ns),
        "end_ns": str(schedule.end_ns + schedule.start_ns),
        "time_base": "simulated nanoseconds of the components, which begin at start_ns",
    }


_LATER = {
    "delay": None,
    "duplicate": 0.0,
    "queue_limit": None,
    "windows": (),
    "adjustable": False,
    "playout_ns": 0,
    "recording": None,
    "greatest_age_ns": 0,
    "on_age": "zero",
    "hop": None,
}
"""Later fields of links and their unused values, which are left out: old traces lack them."""


def _medium_entry(link: Link) -> dict[str, str]:
    """Return the entry of the medium that a link shares, if it does."""
    if not isinstance(link, PacketLink) or link.hop is None:
        return {}
    medium = link.hop.medium
    return {f"medium.{medium.name}": json.dumps(asdict(medium), sort_keys=True)}


def _link_entry(link: Link) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for each in fields(link):
        value = getattr(link, each.name)
        if isinstance(value, DelayProfile):
            found[each.name] = {
                "times_ns": value.times_ns.tolist(),
                "delays_ns": value.delays_ns.tolist(),
                "interpolation": value.interpolation,
            }
        elif isinstance(value, Recording):  # its rows are in the scenario
            found[each.name] = {
                "messages": len(value),
                "sha256": value.sha256,
                **{key.field: getattr(value, key.field) for key in keys_of(Recording).values()},
            }
        elif isinstance(value, Hop):
            found[each.name] = [value.medium.name, value.sender, value.receiver, value.packet]
        elif isinstance(value, tuple):
            found[each.name] = [asdict(item) for item in value]
        elif is_dataclass(value) and not isinstance(value, type):
            found[each.name] = asdict(value)
        else:
            found[each.name] = value
        if each.name in _LATER and value == _LATER[each.name]:
            del found[each.name]
    return found


def _certificate(prepared: PreparedScenario, design: Result) -> tuple[dict[str, str], Attachment]:
    """Return the entries of `cosim.run` about the certificate, and its attachment."""
    proof = hinf.certificate.certificate_bytes(design.certificate)
    part = prepared.loaded.scenario.design
    name = "" if part is None else part.controller
    starts = starts_with(design, prepared.fmus[name])
    own = "its FMU starts with it" if starts else "its FMU starts with another, which did not fly"
    entries = certificate_entries(
        design.certificate["claim"],
        hashlib.sha256(proof).hexdigest(),
        f"K[i,j] of {name} as set for this run; {own}",
    )
    return entries, Attachment(CERTIFICATE_ATTACHMENT, "application/json", proof)
