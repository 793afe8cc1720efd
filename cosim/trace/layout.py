"""How a run lies in an MCAP file: topics, signals, protobuf fields, schemas.

A topic is one component and direction (`/plant/output`) or one link (`/link/<name>`). Its
schema is a flat protobuf message made at run time, one `optional` field per signal: with
presence tracked, a zero is written like any other number, so that a row of doubles always has
the same length, and a value that is absent differs from zero.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

from cosim.core import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

Kind = Literal["float", "int", "bool", "string"]

RUN, RESULT = "cosim.run", "cosim.result"
"""Names of the metadata records that open and close a trace."""

RECOVERED = "cosim.recovered"
"""Metadata record of a recovered file, which says what was lost; no part of the content hash."""

HOST_PREFIX = "host."
"""Metadata keys that begin so (wall clock, machine) are no part of the content hash."""

SCENARIO_ATTACHMENT, DESIGN_ATTACHMENT = "scenario.toml", "design.json"
CERTIFICATE_ATTACHMENT, CERTIFICATE_HASH = "certificate.json", "certificate.sha256"
"""What a run with a design attaches, and the key of `cosim.run` with the proof's SHA-256."""

LOG_TOPIC, POSE_TOPIC, FRAME_TOPIC = "/log", "/auv/pose", "/tf"

_TYPES: Mapping[str, int] = {
    "float": FieldDescriptorProto.TYPE_DOUBLE,
    "int": FieldDescriptorProto.TYPE_INT64,
    "bool": FieldDescriptorProto.TYPE_BOOL,
    "string": FieldDescriptorProto.TYPE_STRING,
}


@dataclass(frozen=True, slots=True)
class Signal:
    """One signal of a topic.

    Parameters
    ----------
    name : FMI name, `eta.x`, `K[1,3]`.
    value_reference : FMI value reference, None for what is no FMI variable.
    unit : as in the model description, None if there is none.
    kind : "float", "int", "bool" or "string".
    hold : how the value goes on between two messages: "continuous" (interpolate), "discrete"
        (hold), "constant"; FMI's variability says which.
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


DROPPED_SIGNALS = (
    Signal("reason", kind="string", description="why the message was not used: lost, overtaken"),
)
"""Signals of `/link/<name>/dropped`."""


def output_topic(component: str) -> str:
    """Topic of what a component sends: `/plant/output`."""
    return f"/{component}/output"


def input_topic(component: str) -> str:
    """Topic of what a component receives: `/plant/input`."""
    return f"/{component}/input"


def link_topic(link: str) -> str:
    """Topic of what a link delivers: `/link/<name>`."""
    return f"/link/{link}"


def dropped_topic(link: str) -> str:
    """Topic of what a link does not deliver: `/link/<name>/dropped`."""
    return f"/link/{link}/dropped"


def component_of(topic: str) -> str | None:
    """Component whose output or input a topic is; None for other topics."""
    found = re.fullmatch(r"/([^/]+)/(?:output|input)", topic)
    return found[1] if found else None


def field_names(names: Sequence[str]) -> list[str]:
    """Protobuf field names of FMI names: `eta.x` to `eta_x`, `K[1,3]` to `K_1_3`.

    Every character outside [A-Za-z0-9] becomes `_`; underscores at the end are cut off; a name
    that does not begin with a letter gets `x_` in front. A name already taken, also one that
    differs in case or underscores alone (protobuf's JSON names would collide), gets `_2`,
    `_3`, ... in the order given.
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
    """Descriptor of the flat proto3 message `schema_name` (`package.Message`).

    Field i + 1 is signal i, `optional` and of the type of its kind.

    Raises
    ------
    InputError : a schema name that is no protobuf name, or a signal named twice.
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
    return FileDescriptorProto(
        name=f"{schema_name.replace('.', '/')}.proto",
        package=package,
        syntax="proto3",
        message_type=[message],
    )


def message_class(files: FileDescriptorSet, schema_name: str) -> type[Any]:
    """Message class of `schema_name`, from descriptors in order of dependence."""
    pool = DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(schema_name))


def channel_metadata(signals: Sequence[Signal]) -> dict[str, str]:
    """Channel metadata of a topic: `<field>.name`, `.kind`, `.hold`, `.vr`, `.unit`, ...

    What is None has no entry.
    """
    entries: dict[str, str] = {}
    for field, signal in zip(field_names([s.name for s in signals]), signals, strict=True):
        entries[f"{field}.name"] = signal.name
        entries[f"{field}.hold"] = signal.hold
        if signal.value_reference is not None:
            entries[f"{field}.vr"] = str(signal.value_reference)
        if signal.unit is not None:
            entries[f"{field}.unit"] = signal.unit
        if signal.description is not None:
            entries[f"{field}.description"] = signal.description
    return entries


def signal_of(field: str, kind: Kind, metadata: Mapping[str, str]) -> Signal:
    """Signal that `channel_metadata` described; the field name where it has no entry."""
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
    """Entries of `cosim.run` that name the certificate of the gain that flies.

    Parameters
    ----------
    claim : what is proved, JSON values.
    sha256 : of the attachment `CERTIFICATE_ATTACHMENT`.
    gain : whose gain it is about, in words.
    """
    return {
        CERTIFICATE_HASH: sha256,
        "certificate.attachment": CERTIFICATE_ATTACHMENT,
        "certificate.claim": json.dumps(claim, sort_keys=True, allow_nan=False),
        "certificate.gain": gain,
    }


def certificate_of(run: Mapping[str, str]) -> dict[str, Any] | None:
    """`attachment`, `claim` (as an object), `gain` and `sha256` of a run; None without any."""
    if CERTIFICATE_HASH not in run:
        return None
    found: dict[str, Any] = {
        name: run.get(f"certificate.{name}") for name in ("attachment", "claim", "gain", "sha256")
    }
    try:
        found["claim"] = json.loads(found["claim"] or "null", parse_constant=_refuse)
    except (ValueError, RecursionError):
        found["claim"] = None
    return found


def _refuse(constant: str) -> float:
    raise ValueError(constant)


def result_of_link(link: str, statistics: Mapping[str, Any]) -> dict[str, str]:
    """Entries of `cosim.result` for a link: `link.<name>.<figure>`; None has no entry."""
    return {
        f"link.{link}.{key}": str(value) for key, value in statistics.items() if value is not None
    }
