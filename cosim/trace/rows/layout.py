"""The layout of a run in an MCAP file: topics, signals, protobuf fields, schemas.

A topic is one component and direction (`/plant/output`) or one link (`/link/<name>`). Its schema is
a flat protobuf message made at run time, one `optional` field per signal. An optional zero is
written like any other number: a row of doubles has a fixed length, and an absent value is not zero.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

from cosim.core import InputError

Kind = Literal["float", "int", "uint", "bool", "string"]

RUN = "cosim.run"
"""Name of the first metadata record of a trace."""

RESULT = "cosim.result"
"""Name of the last one, which a run that did not end by itself lacks."""

RECOVERED = "cosim.recovered"
"""Metadata record of a recovered file that says what was lost; not part of the content hash."""

ROW_FORMAT, NEWEST_ROW_FORMAT = "row_format", "2"
"""Entry of `cosim.run`: "2": numbers in rows have a fixed width; absent (1): it varies."""

HOST_PREFIX = "host."
"""Prefix of metadata keys (wall clock, machine) that are not part of the content hash."""

SCENARIO_ATTACHMENT = "scenario.toml"
"""Attachment with the scenario as it was run."""

DESIGN_ATTACHMENT = "design.json"
"""Attachment with the design of a run that has one."""

CERTIFICATE_ATTACHMENT = "certificate.json"
"""Attachment with the proof of that design."""

CERTIFICATE_HASH = "certificate.sha256"
"""Key of `cosim.run` with the SHA-256 of that proof."""

LOG_TOPIC, FRAME_TOPIC = "/log", "/tf"

FIXED_FRAME_TOPIC = "/tf_static"
"""Frames that do not move, by themselves: a viewer that jumps gets the last message of a topic."""

SCENE_SCHEMAS = "cosim.scene.link."
"""Beginning of the schema names of rows that tell about the run; not part of the content hash.

One part longer than that of any component, which may be called `scene`.
"""

GREATEST_AGE = "greatest_age_ns"
"""Metadata of the topic of a link: the age [ns] from which on `on_loss` replaces its messages."""

LINK_STATE_SCHEMA = f"{SCENE_SCHEMAS}State"
"""Schema of what a link is doing, ten times a second."""

VEHICLE = "auv"
"""Frame of the vehicle, where a run has one, and the first part of its topics."""

COMPUTED: Mapping[str, str] = {"computed": "from the topics of components and links"}
"""Metadata of a channel whose messages follow from those of others."""

DTYPES: Mapping[Kind, Any] = {
    "float": float,
    "int": np.int64,
    "uint": np.uint64,
    "bool": bool,
    "string": object,
}
"""NumPy type of a column, by the kind of its signal."""

_TYPES: Mapping[str, int] = {
    "float": FieldDescriptorProto.TYPE_DOUBLE,
    "int": FieldDescriptorProto.TYPE_SFIXED64,
    "uint": FieldDescriptorProto.TYPE_FIXED64,
    "bool": FieldDescriptorProto.TYPE_BOOL,
    "string": FieldDescriptorProto.TYPE_STRING,
}


@dataclass(frozen=True, slots=True)
class Signal:
    """One signal of a topic.

        >>> from cosim import Trace
        >>> from cosim.trace import Signal, TraceWriter
        >>> depth = Signal("z", unit="m", hold="continuous", description="depth")
        >>> with TraceWriter("dive.mcap", run={}) as writer:
        ...     number = writer.add_topic("/log/depth", [depth], schema_name="log.Depth")
        ...     path = writer.finish({"status": "finished"})
        >>> Trace(path).topics["/log/depth"].signals[0].unit
        'm'

    Parameters
    ----------
    name : FMI name, `eta.x`, `K[1,3]`.
    value_reference : FMI value reference, None if the signal is no FMI variable.
    unit : as in the model description, None if there is none.
    kind : "float", "int", "uint" (of 64 bits), "bool" or "string".
    hold : the value between two messages, from FMI's variability: "continuous" (interpolate),
        "discrete" (hold) or "constant".
    description : one line, None if there is none.

    Raises
    ------
    InputError : an empty name, or an unknown kind.
    """

    name: str
    value_reference: int | None = None
    unit: str | None = None
    kind: Kind = "float"
    hold: str = "discrete"
    description: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(
                "a signal needs a name",
                where="signal",
                expected="a non-empty string",
                got=repr(self.name),
            )
        if self.kind not in get_args(Kind):
            raise InputError(
                "unknown kind of signal",
                where=f"signal {self.name!r}: kind",
                expected="one of " + ", ".join(get_args(Kind)),
                got=repr(self.kind),
            )


MODE_SIGNALS = (
    Signal("state", kind="string", description="state that the machine is in from now on"),
    Signal("number", kind="int", description="its number, from 0"),
)
"""Signals of a mode machine, one row per change."""

LINK_STATE_SIGNALS = (
    Signal("age_s", unit="s", description="time since the message in use was sent"),
    Signal("in_flight", kind="int", description="messages sent that are neither here nor dropped"),
    Signal("delivered", kind="int", description="messages delivered so far"),
    Signal(
        "lost", kind="int", description="messages known to be lost so far, each when it was due"
    ),
    Signal(
        "dropped", kind="int", description="messages not used so far: lost, overtaken, late, ..."
    ),
    Signal(
        "outage", kind="bool", description="whether the scenario keeps the link from delivering"
    ),
)
"""Signals of `/link/<name>/state`."""

DROPPED_SIGNALS = (
    Signal("reason", kind="string", description="why the message was not used: lost, overtaken"),
)
"""Signals of `/link/<name>/dropped`."""

NOTICED_REASONS = ("lost", "late", "collided", "receiver sending", "out of range")
"""Those of its reasons after which the receiver uses the substitute of a link that has one."""


def output_topic(component: str) -> str:
    """Return the topic of a component's outputs: `/plant/output`."""
    return f"/{component}/output"


def input_topic(component: str) -> str:
    """Return the topic of a component's inputs: `/plant/input`."""
    return f"/{component}/input"


def link_topic(link: str) -> str:
    """Return the topic of a link's delivered messages: `/link/<name>`."""
    return f"/link/{link}"


def modes_topic(machine: str) -> str:
    """Return the topic of the states of a mode machine: `/modes/<name>`."""
    return f"/modes/{machine}"


def dropped_topic(link: str) -> str:
    """Return the topic of a link's dropped messages: `/link/<name>/dropped`."""
    return f"/link/{link}/dropped"


def link_state_topic(link: str) -> str:
    """Return the topic of a link's age and counts: `/link/<name>/state`."""
    return f"/link/{link}/state"


def pose_topic(vehicle: str) -> str:
    """Return the topic of a vehicle's pose: `/auv/pose`."""
    return f"/{vehicle}/pose"


def reference_topic(vehicle: str) -> str:
    """Return the topic of the pose that a vehicle is to have: `/auv/reference`."""
    return f"/{vehicle}/reference"


def hull_topic(vehicle: str) -> str:
    """Return the topic of a vehicle's hull: `/auv/hull`."""
    return f"/{vehicle}/hull"


def path_topic(vehicle: str) -> str:
    """Return the topic of the path that a vehicle has flown so far: `/auv/path`."""
    return f"/{vehicle}/path"


def component_of(topic: str) -> str | None:
    """Return the component whose outputs or inputs a topic has; None for other topics."""
    found = re.fullmatch(r"/([^/]+)/(?:output|input)", topic)
    return found[1] if found else None


def signal_name(topic: str, name: str) -> str:
    """Return the name `Trace.signal` takes: `plant.eta.x`, or `/link/uplink:plant.eta.x`."""
    component = component_of(topic)
    return f"{component}.{name}" if component else f"{topic}:{name}"


def field_names(names: Sequence[str]) -> list[str]:
    """Turn FMI names into protobuf field names: `eta.x` to `eta_x`, `K[1,3]` to `K_1_3`.

    Every character outside [A-Za-z0-9] becomes `_`; underscores at the end are removed; a name
    that does not begin with a letter gets the prefix `x_`. A name that is taken, or differs from
    one only in case or underscores (equal JSON names in protobuf), gets `_2`, `_3`, ...
    """
    taken: set[str] = set()
    result = []
    for name in names:
        base = re.sub(r"[^A-Za-z0-9]", "_", name).rstrip("_")
        if not re.match(r"[A-Za-z]", base):
            base = f"x_{base.lstrip('_')}".rstrip("_")
        candidate, number = base, 1
        while (key := candidate.replace("_", "").lower()) in taken:
            number += 1
            candidate = f"{base}_{number}"
        taken.add(key)
        result.append(candidate)
    return result


def file_descriptor(schema_name: str, signals: Sequence[Signal]) -> FileDescriptorProto:
    """Describe the flat proto3 message `schema_name` (`package.Message`) of a topic's rows.

    Field i + 1 is signal i, `optional`, of the type of its kind. Its comment is the signal's name,
    unit and description.

    Raises
    ------
    InputError : the schema name is no protobuf name, or two signals have the same name.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*(\.[A-Za-z][A-Za-z0-9_]*)*", schema_name):
        raise InputError(
            "not a schema name",
            where="add_topic: schema_name",
            expected="letters, digits and _ in parts joined by dots, cosim.plant.Output",
            got=repr(schema_name),
        )
    names = [signal.name for signal in signals]
    if len(set(names)) < len(names):
        raise InputError(
            "a signal is named twice",
            where=f"add_topic: {schema_name}",
            expected="each name once",
            got=", ".join(sorted({name for name in names if names.count(name) > 1})),
        )
    package, _, message_name = schema_name.rpartition(".")
    message = DescriptorProto(name=message_name)
    for i, (signal, name) in enumerate(zip(signals, field_names(names), strict=True)):
        message.oneof_decl.add(name=f"_{name}")  # how proto3 spells `optional` in a descriptor
        message.field.add(
            name=name,
            number=i + 1,
            type=_TYPES[signal.kind],
            label=FieldDescriptorProto.LABEL_OPTIONAL,
            proto3_optional=True,
            oneof_index=i,
        )
    file = FileDescriptorProto(
        name=f"{schema_name.replace('.', '/')}.proto",
        package=package,
        syntax="proto3",
        message_type=[message],
    )
    for i, signal in enumerate(signals):
        file.source_code_info.location.add(
            path=(*_FIRST_MESSAGE, _FIELD, i), span=(i, 0, 0), leading_comments=_comment(signal)
        )
    return file


def in_fixed_width(data: bytes) -> bytes:
    """Return the schema of a topic of flat rows as it is where numbers have a fixed width."""
    files = FileDescriptorSet.FromString(data)
    for field in (field for file in files.file for m in file.message_type for field in m.field):
        field.type = _FIXED.get(field.type, field.type)
    return files.SerializeToString(deterministic=True)


_FIXED: Mapping[int, FieldDescriptorProto.Type.ValueType] = {
    FieldDescriptorProto.TYPE_INT64: FieldDescriptorProto.TYPE_SFIXED64,
    FieldDescriptorProto.TYPE_UINT64: FieldDescriptorProto.TYPE_FIXED64,
}
_FIRST_MESSAGE = FileDescriptorProto.MESSAGE_TYPE_FIELD_NUMBER, 0
_FIELD = DescriptorProto.FIELD_FIELD_NUMBER
"""Place of a field in a file, as `SourceCodeInfo` gives it: message_type[0].field[i]."""


def _comment(signal: Signal) -> str:
    """Return the comment of a signal's field: ` eta.x [m]: position north`."""
    unit = f" [{signal.unit}]" if signal.unit is not None else ""
    return f" {signal.name}{unit}" + (f": {signal.description}" if signal.description else "")


def message_class(files: FileDescriptorSet, schema_name: str) -> type[Any]:
    """Make the message class of `schema_name`; each file comes after those it imports."""
    pool = DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(schema_name))


def channel_metadata(signals: Sequence[Signal]) -> dict[str, str]:
    """Describe signals in a channel's metadata: `<field>.name`, `.hold`, `.vr`, `.unit`, ...

    An attribute that is None has no entry.
    """
    entries: dict[str, str] = {}
    for field, signal in zip(field_names([s.name for s in signals]), signals, strict=True):
        described = {
            "name": signal.name,
            "hold": signal.hold,
            "vr": signal.value_reference,
            "unit": signal.unit,
            "description": signal.description,
        }
        entries |= {f"{field}.{k}": str(v) for k, v in described.items() if v is not None}
    return entries


def signal_of(field: str, kind: Kind, metadata: Mapping[str, str]) -> Signal:
    """Read a signal back from a channel's metadata; its name is the field's where none is given."""
    reference = metadata.get(f"{field}.vr", "")
    return Signal(
        name=metadata.get(f"{field}.name") or field,
        value_reference=int(reference) if reference.isdecimal() else None,
        unit=metadata.get(f"{field}.unit"),
        kind=kind,
        hold=metadata.get(f"{field}.hold", "discrete"),
        description=metadata.get(f"{field}.description"),
    )


def certificate_entries(claim: Mapping[str, Any], sha256: str, gain: str) -> dict[str, str]:
    """Return the entries of `cosim.run` that name the certificate of the gain in use.

    Parameters
    ----------
    claim : what is proved, as JSON values.
    sha256 : of the attachment `CERTIFICATE_ATTACHMENT`.
    gain : which gain the certificate is about, in words.
    """
    return {
        CERTIFICATE_HASH: sha256,
        "certificate.attachment": CERTIFICATE_ATTACHMENT,
        "certificate.claim": json.dumps(claim, sort_keys=True, allow_nan=False),
        "certificate.gain": gain,
    }


def certificate_of(run: Mapping[str, str]) -> dict[str, Any] | None:
    """Return `attachment`, `claim` (as an object), `gain` and `sha256`; None without certificate.

    run : the entries of `cosim.run`.
    """
    if CERTIFICATE_HASH not in run:
        return None
    names = ("attachment", "claim", "gain", "sha256")
    found: dict[str, Any] = {name: run.get(f"certificate.{name}") for name in names}
    found["claim"] = parsed_json(found["claim"])
    return found


def parsed_json(data: str | bytes | None) -> Any:
    """Parse JSON of any origin; None for text that is no JSON, NaN and infinity included."""
    try:
        return json.loads(data or "null", parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None


def _refuse(constant: str) -> float:
    raise ValueError(constant)


def result_of_link(link: str, statistics: Mapping[str, Any]) -> dict[str, str]:
    """Return a link's entries of `cosim.result`, `link.<name>.<figure>`; None has no entry."""
    return {f"link.{link}.{k}": str(v) for k, v in statistics.items() if v is not None}
