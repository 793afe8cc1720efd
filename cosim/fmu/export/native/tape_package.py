"""Build the native FMU of a component without a compiler: a binary of its kind, and its model."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from cosim.fmu.export.components import component_module
from cosim.fmu.export.deterministic_zip import deterministic_zip
from cosim.fmu.export.native.c_model import ModelWriter
from cosim.fmu.export.native.compiler import STANDARD, shared_library
from cosim.fmu.export.native.kinds import recorded_model, shared_headers
from cosim.fmu.export.native.native_package import fmu_files, hand_written
from cosim.fmu.export.native.tape_model import model_data, model_header
from cosim.fmu.export.native.target_platforms import PLATFORMS, Platform
from cosim.fmu.export.spec import ComponentSpec
from cosim.fmu.prebuilt import prebuilt_file, why_none_prebuilt
from cosim.network import PacketLink, TransportLink

MODEL = "resources/model.bin"
KINDS = {
    "plant.c": "plant",
    "vehicle.c": "vehicle",
    "sampled.c": "feedback",
    "sampled_watched.c": "watched_feedback",
    "packet_link.c": "packet_link",
    "transport_link.c": "transport_link",
    "table.c": "table",
    "observer.c": "observer",
    "sensor.c": "sensor",
    "computed.c": "computed",
    "plain_sensor.c": "plain_sensor",
}
"""C file of a kind of behaviour -> name of its binary that reads the model."""


def prebuilt_binaries(spec: ComponentSpec, version: str) -> dict[Platform, bytes]:
    """Return the prebuilt binaries for a component; none if there are none for its kind."""
    found: dict[Platform, bytes] = {}
    if why_none_prebuilt() is not None:
        return found
    _, sources = recorded_model(spec)
    for target in PLATFORMS.values():
        for kind in (KINDS[source] for source in sources if source in KINDS):
            file = prebuilt_file(_binary_path(kind, version, target))
            if file is not None:
                found[target] = file.read_bytes()
    return found


def build_tape_fmu(
    spec: ComponentSpec, destination: Path, version: str, binaries: Mapping[Platform, bytes]
) -> Path:
    """Write `destination`/NAME.fmu with binaries of its kind; return its path.

    Raises
    ------
    InputError : a component that is too large for them.
    """
    writer, own = recorded_model(spec)
    content, compiled = tape_sources(writer, own, version)
    archive = fmu_files(spec, version, "", compiled)
    options = " ".join(STANDARD).encode()
    unnamed = {MODEL: model_data(writer, ""), "options": options}
    identity = spec.guid({**content, **archive, **unnamed})
    archive = fmu_files(spec, version, identity, compiled)
    archive[MODEL] = model_data(writer, identity)
    archive.update({f"sources/{name}": text for name, text in content.items()})
    for target, binary in binaries.items():
        archive[f"binaries/{target.folder(version)}/{spec.name}{target.suffix}"] = binary
    return deterministic_zip(archive, destination / f"{spec.name}.fmu")


def tape_sources(
    writer: ModelWriter, own: tuple[str, ...], version: str
) -> tuple[dict[str, bytes], list[str]]:
    """Return the files of sources/ by name, and those of them to compile: the same for a kind."""
    found, compiled = hand_written(("tape.c", *own), version)
    found["model.h"] = model_header(writer).encode()
    found |= {name: text.encode() for name, text in shared_headers(own).items()}
    return found, compiled


def write_binary(kind: str, version: str, folder: Path, target: Platform) -> None:
    """Cross-compile the binary of a kind to where it is looked for below the folder of a wheel.

    Raises
    ------
    InputError : no cross compiler.
    """
    # any plant does for a vehicle: what it is, the binary reads
    writer, own = recorded_model(_specimens()["plant" if kind == "vehicle" else kind])
    if kind == "vehicle":
        own = tuple("vehicle.c" if name == "plant.c" else name for name in own)
    content, compiled = tape_sources(writer, own, version)
    path = folder / _binary_path(kind, version, target)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(shared_library(kind, content, compiled, target, cross=True))


def _binary_path(kind: str, version: str, target: Platform) -> str:
    """Return where the binary of a kind lies below the folder of what is prebuilt."""
    return f"binaries/fmi{version[0]}/{target.tuple_name}/{kind}{target.suffix}"


def _a_pair() -> ComponentSpec:
    """Return an output feedback of one state."""
    one = [[1.0]]
    plant = {"A": one, "B": one, "delays": []}
    measured = [{"name": "y", "C": one, "d": 1.0}]
    pair = {
        "kind": "output-feedback",
        "plant": plant,
        "measurements": measured,
        "K": one,
        "L": [one],
    }
    variables = component_module("observer.variables")
    found: ComponentSpec = variables.output_feedback_spec("Pair", json.dumps(pair).encode())
    return replace(found, certificate=None)


@functools.cache
def _specimens() -> dict[str, ComponentSpec]:
    """Return a component of each kind; which one does not matter for the binary."""
    link = component_module("link_channel.variables")
    signals = [link.LinkSignal()]
    return {
        "plant": component_module("delayed_plant.variables").SPEC,
        "feedback": component_module("hinf_controller.variables").PAPER_SPEC,
        "watched_feedback": component_module("hinf_controller.variables").watched_spec(
            component_module("hinf_controller.variables").PAPER_SPEC, age=1.0
        ),
        "observer": _a_pair(),
        "packet_link": link.packet_spec("Link", PacketLink("link", sample_time_ns=1), signals),
        "transport_link": link.transport_spec("Link", TransportLink("link"), signals),
        "table": component_module("signal_table.variables").table_spec(
            "Signals", [("y", None)], [0], [[0.0]], 1.0
        ),
        "sensor": component_module("sensor.variables").SPEC,
        "computed": component_module("computed.variables").computed_spec(
            "Computed", [], [("y", None, "a number")], [["symbol", "t"]], [0], [[]], 1.0
        ),
        "plain_sensor": component_module("plain_sensor.variables").plain_sensor_spec(
            "PlainSensor", [("y", None)], {}
        ),
    }
