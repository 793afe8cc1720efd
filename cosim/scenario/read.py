"""Read and validate a scenario from a built-in name, a file or a text."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cosim import recordings
from cosim.core import NOWHERE, Findings, Layer, Origin, valid
from cosim.network import DelayProfile, LogFormat, Recording, keys_of
from cosim.scenario.extend import (
    Source,
    give_way,
    open_source,
    read_text,
    source_of,
)
from cosim.scenario.input_files import with_values
from cosim.scenario.key_paths import put, setting
from cosim.scenario.link_keys import of_part
from cosim.scenario.links import (
    LogFormatPart,
    PacketPart,
    ProfileFilePart,
    ProfilePart,
    RecordingFilePart,
    RecordingPart,
)
from cosim.scenario.schema import ScenarioPart

__all__ = [
    "LoadedScenario",
    "load",
    "parse",
    "read_text",
]


@dataclass(frozen=True)
class LoadedScenario:
    """A validated scenario with the text it was read from.

    Attributes
    ----------
    name : the built-in name, or the file's stem.
    text : complete TOML: the file itself, or merged with what it extends and with settings.
    folder : start of relative FMU paths.
    origin : locates its parts in messages.
    source_sha256 : of the file itself, if `text` is merged.
    file : the user's file; None if it was not read from one.
    """

    name: str
    scenario: ScenarioPart
    text: str
    folder: Path
    origin: Origin = NOWHERE
    source_sha256: str | None = None
    file: Path | None = None


def load(
    name_or_path: str,
    settings: Sequence[str] = (),
    stops: Mapping[str, Mapping[str, Any]] | None = None,
) -> LoadedScenario:
    """Load a built-in scenario by name, or a TOML file by path.

    settings : KEY=VALUE each.
    stops : events that end the run, by their name in messages.

    Raises
    ------
    InputError : no such scenario, malformed TOML, or a scenario that breaks the schema.
    """
    source = with_settings(open_source(name_or_path), settings)
    return loaded_of(_with_stops(source, stops or {}))


def parse(text: str, *, name: str, where: str, folder: Path) -> LoadedScenario:
    """Validate the TOML text of a scenario; `where` names it in messages."""
    return loaded_of(source_of(text, name=name, where=where, folder=folder))


def of_scenario(scenario: ScenarioPart, name: str, folder: Path | None = None) -> LoadedScenario:
    """Load a scenario that was built in Python."""
    text = scenario.to_toml()
    origin = Origin((Layer(f"{name}.toml", text),))
    return LoadedScenario(name, scenario, text, folder or Path.cwd(), origin)


def with_settings(source: Source, settings: Sequence[str]) -> Source:
    """Apply `KEY=VALUE` settings to a source, in their order."""
    data, layers = copy.deepcopy(source.data), list(source.layers)
    parts = [(text, *setting(text)) for text in settings]
    give_way(data, {str(path[1]) for _, path, _ in parts if path[0] == "design" and len(path) > 1})
    for text, path, value in parts:
        put(data, path, value, f"`set` {text}")
        layers.append(Layer(f"`set` {text}", "", path))
    return replace(source, data=data, layers=tuple(layers))


def _with_stops(source: Source, stops: Mapping[str, Mapping[str, Any]]) -> Source:
    """Add events that end the run to a source, so that a rerun of its trace has them too."""
    data, layers = copy.deepcopy(source.data), list(source.layers)
    for where, event in stops.items():
        events = data.setdefault("events", [])
        if isinstance(events, list):
            layers.append(Layer(where, "", ("events", len(events))))
            events.append({**event, "stop": where})
    return replace(source, data=data, layers=tuple(layers))


def loaded_of(source: Source) -> LoadedScenario:
    """Validate a source and read the files that it names.

    Raises
    ------
    InputError : it breaks the schema, or a file cannot be read.
    """
    data, origin = source.written_out()
    found = valid(ScenarioPart, data, origin)
    scenario = with_files(found, source.folder, Findings(origin))
    text, digest = [layer.text for layer in source.layers if layer.path is None][-1], None
    if len(source.layers) > 1 or scenario is not found or origin.copies:
        digest, text = hashlib.sha256(text.encode()).hexdigest(), scenario.to_toml()
    return LoadedScenario(source.name, scenario, text, source.folder, origin, digest, source.file)


def with_files(scenario: ScenarioPart, folder: Path, findings: Findings) -> ScenarioPart:
    """Replace what is in files by its values: the scenario then needs no other file."""
    links = dict(scenario.links)
    for name, part in scenario.links.items():
        if isinstance(part, PacketPart) and isinstance(part.recording, RecordingFilePart):
            with findings.at("links", name, "recording"):
                played = _messages(part.recording, folder, name)
                links[name] = part.model_copy(update={"recording": played})
        if isinstance(part.delay, ProfileFilePart):
            with findings.at("links", name, "delay"):
                links[name] = part.model_copy(update={"delay": _recorded(part.delay, folder)})
    inputs = list(scenario.inputs)
    for i, series in enumerate(scenario.inputs):
        with findings.at("inputs", i):
            inputs[i] = with_values(series, folder)
    if links == scenario.links and inputs == scenario.inputs:
        return scenario
    return scenario.model_copy(update={"links": links, "inputs": inputs})


def _messages(part: RecordingFilePart, folder: Path, link: str) -> RecordingPart:
    found = recordings.read_recording(
        folder / part.file, part.node, default=link, log_format=_log_format(part.format)
    )
    delays = found.delay_ns
    return RecordingPart(
        sent=(found.sent_ns / 1e9).tolist(),
        delays=None
        if delays is None
        else [d / 1e9 if d >= 0 else "in flight" for d in delays.tolist()],
        lost=[k for k, lost in enumerate(found.lost.tolist()) if lost],
        **{name: getattr(part, name) for name in keys_of(Recording)},
    )


def _log_format(part: LogFormatPart | None) -> LogFormat:
    return of_part(LogFormat, part or LogFormatPart(), hints="toml")


def _recorded(part: ProfileFilePart, folder: Path) -> ProfilePart:
    profile = DelayProfile.from_csv(
        folder / part.file,
        time=part.time,
        delay=part.delay,
        interpolation=part.interpolation,
        log_format=_log_format(part.format),
    )
    return ProfilePart(
        times=[t / 1e9 for t in profile.times_ns.tolist()],
        delays=[d / 1e9 for d in profile.delays_ns.tolist()],
        interpolation=profile.interpolation,
    )
