"""From a name or a file to a validated `Scenario`."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from cosim.core import InputError
from cosim.network import DelayProfile
from cosim.scenario.extend import (
    Source,
    builtin_names,
    give_way,
    open_source,
    read_text,
    source_of,
)
from cosim.scenario.key_paths import put, setting
from cosim.scenario.links import ProfileFilePart, ProfilePart
from cosim.scenario.origin import NOWHERE, Findings, Layer, Origin
from cosim.scenario.schema import Scenario
from cosim.scenario.schema_errors import refusals

__all__ = ["LoadedScenario", "builtin_names", "load", "parse", "read_text", "valid", "validated"]

Model = TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True)
class LoadedScenario:
    """A scenario with the text it was read from.

    Attributes
    ----------
    name : the built-in name, or the file's stem.
    text : TOML that says all of it: as it stands, or, of what extends another scenario or was
        set on the command line, put together.
    folder : where relative FMU paths are looked up.
    origin : where its parts stand.
    source_sha256 : of the file itself, where `text` is put together.
    file : the file of a user that it was read from; None if it was not.
    """

    name: str
    scenario: Scenario
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
    """A built-in scenario by name, or a TOML file by path.

    settings : KEY=VALUE each.
    stops : events that end the run, by what they are called in messages.

    Raises
    ------
    InputError : no such scenario, malformed TOML, or a scenario that breaks the schema.
    """
    source = with_settings(open_source(name_or_path), settings)
    return loaded_of(_with_stops(source, stops or {}))


def parse(text: str, *, name: str, where: str, folder: Path) -> LoadedScenario:
    """Validate the TOML text of a scenario; `where` stands in the messages."""
    return loaded_of(source_of(text, name=name, where=where, folder=folder))


def of_scenario(scenario: Scenario, name: str, folder: Path | None = None) -> LoadedScenario:
    """A scenario that was built in Python, ready to be prepared and flown."""
    text = scenario.to_toml()
    origin = Origin((Layer(f"{name}.toml", text),))
    return LoadedScenario(name, scenario, text, folder or Path.cwd(), origin)


def with_settings(source: Source, settings: Sequence[str]) -> Source:
    """The source with what `KEY=VALUE` texts set, in their order."""
    data, layers = copy.deepcopy(source.data), list(source.layers)
    parts = [(text, *setting(text)) for text in settings]
    give_way(data, {str(path[1]) for _, path, _ in parts if path[0] == "design" and len(path) > 1})
    for text, path, value in parts:
        put(data, path, value, f"--set {text}")
        layers.append(Layer(f"--set {text}", "", path))
    return replace(source, data=data, layers=tuple(layers))


def _with_stops(source: Source, stops: Mapping[str, Mapping[str, Any]]) -> Source:
    """The source with events that end the run: a trace of it can be run again."""
    data, layers = copy.deepcopy(source.data), list(source.layers)
    for where, event in stops.items():
        events = data.setdefault("events", [])
        if isinstance(events, list):
            layers.append(Layer(where, "", ("events", len(events))))
            events.append({**event, "stop": where})
    return replace(source, data=data, layers=tuple(layers))


def loaded_of(source: Source) -> LoadedScenario:
    """A source validated, and files that it names read.

    Raises
    ------
    InputError : it breaks the schema, or a file cannot be read.
    """
    found = valid(Scenario, source.data, Origin(source.layers))
    scenario = with_files(found, source.folder, Findings(Origin(source.layers)))
    own = [layer for layer in source.layers if layer.path is None]
    text = own[-1].text
    if len(source.layers) == 1 and scenario is found:
        digest = None
    else:
        digest, text = hashlib.sha256(text.encode()).hexdigest(), scenario.to_toml()
    origin = Origin(source.layers)
    return LoadedScenario(source.name, scenario, text, source.folder, origin, digest, source.file)


def with_files(scenario: Scenario, folder: Path, findings: Findings) -> Scenario:
    """The scenario with the delays in it that files hold: a run is to need no other file."""
    links = dict(scenario.links)
    for name, part in scenario.links.items():
        if isinstance(part.delay, ProfileFilePart):
            with findings.at("links", name, "delay"):
                links[name] = part.model_copy(update={"delay": _recorded(part.delay, folder)})
    if links == scenario.links:
        return scenario
    return scenario.model_copy(update={"links": links})


def _recorded(part: ProfileFilePart, folder: Path) -> ProfilePart:
    profile = DelayProfile.from_csv(
        folder / part.file,
        time=part.time,
        delay=part.delay,
        interpolation=part.interpolation,
    )
    return ProfilePart(
        times=[t / 1e9 for t in profile.times_ns.tolist()],
        delays=[d / 1e9 for d in profile.delays_ns.tolist()],
        interpolation=profile.interpolation,
    )


def validated(model: type[Model], text: str, data: dict[str, Any], where: str) -> Model:
    """The `data` of a TOML `text` as an object of `model`.

    Raises
    ------
    InputError : it breaks the model; says file, line, key, and the nearest keys there are.
    """
    return valid(model, data, Origin((Layer(where, text),)))


def valid(model: type[Model], data: dict[str, Any], origin: Origin) -> Model:
    """The same of data that come from several layers."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        found = refusals(model, error, data, origin)
        first = found[0]
        if first.hint is None and len(found) > 1:
            first = InputError(
                first.what,
                where=first.where,
                expected=first.expected,
                got=first.got,
                hint=f"{len(found) - 1} more after this one: cosim scenario check",
            )
        raise first from error
