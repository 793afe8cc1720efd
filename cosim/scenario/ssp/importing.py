"""Import an SSP archive: write a scenario, and its FMUs into a folder beside it."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from cosim.core import SCENARIO_FILE, AnyPath, InputError, write_whole
from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import receiving_order
from cosim.scenario.assembly import assemble
from cosim.scenario.read import LoadedScenario, parse
from cosim.scenario.schema import ScenarioPart
from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.flatten import FlatSystem, Path as Place, flatten, scenario_names
from cosim.scenario.ssp.import_wires import connections_of
from cosim.scenario.ssp.names import SSD, ignored_by_others
from cosim.scenario.ssp.ssp_parameters import values_for
from cosim.scenario.ssp.tree import Description, read_description

_MOST_LISTED = 12


@dataclass(frozen=True)
class SspImport:
    """The scenario that was written.

    Attributes
    ----------
    version : of SSP.
    names : element of the archive -> component of the scenario.
    links : from annotations and from link FMUs of this project.
    keys_set : keys of the scenario that the archive does not contain and that it needs to run,
        with their values; the description of the scenario and `unsupported` say why.
    unsupported : sentences about what was left out or changed.
    only_here : sentences about what other tools ignore of the archive.
    """

    path: Path
    version: str
    names: Mapping[str, str]
    connections: int
    links: tuple[str, ...]
    fmus: tuple[str, ...]
    step_s: float
    end_s: float
    unsupported: tuple[str, ...]
    only_here: tuple[str, ...]
    keys_set: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> dict[str, object]:
        """Return what `cosim ssp import --json` prints."""
        return {
            "scenario": str(self.path),
            "components": dict(self.names),
            "connections": self.connections,
            "links": list(self.links),
            "fmus": list(self.fmus),
            "step": self.step_s,
            "end": self.end_s,
            "unsupported": list(self.unsupported),
            "keys_set": dict(self.keys_set),
        }


def import_ssp(
    ssp: AnyPath, path: AnyPath, *, step: float | None = None, end: float | None = None
) -> SspImport:
    """Write a scenario, and the FMUs of the archive into a folder beside it.

        >>> from pathlib import Path
        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.scenario import FmuCache, export_ssp, import_ssp, prepare
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> archive = export_ssp(prepare(lag.loaded(), FmuCache(Path("fmus"), Path())), "lag.ssp")
        >>> imported = import_ssp("lag.ssp", "lag.toml")
        >>> imported.names, imported.end_s, run("lag.toml").status
        ({'lag': 'lag'}, 1.0, 'finished')

    Parameters
    ----------
    path : the TOML file; FMUs go into the folder of its name with `_fmus`.
    step, end : instead of the archive's [s].

    Raises
    ------
    InputError : not a valid archive, essential parts that are not supported, or a file that
        cannot be written.
    """
    ssp, path = Path(ssp), Path(path)
    with Archive(ssp) as archive, _beside(path) as unpacked:
        description = read_description(archive)
        flat = _without(flatten(archive, description.system), description.players)
        channels = {p: part.link for p, part in flat.parts.items() if part.link is not None}
        places = [place for place in flat.parts if place not in channels]
        if not places:
            raise archive.wrong("a system without components", SSD)
        names = scenario_names(places, description.names)
        folder = path.with_name(f"{path.stem}_fmus")
        files = _unpack(archive, flat, places, unpacked)
        entries = {place: flat.parts[place].entry for place in places}
        fmus = {
            place: _described(archive, entry, unpacked / files[entry])
            for place, entry in entries.items()
        }
        links = {**description.links, **{link[0]: link[1] for link in channels.values()}}
        components = {}
        for place in places:
            part, name = flat.parts[place], ".".join(place)
            values = values_for(archive, name, part.bound, fmus[place], description.units)
            table: dict[str, Any] = {"fmu": f"{folder.name}/{files[part.entry]}"}
            components[names[place]] = table | ({"parameters": values} if values else {})
        data: dict[str, Any] = {
            "title": description.text or description.name or ssp.stem,
            "description": f"From {ssp.name}.",
            "run": _run(archive, description, fmus, step, end),
            "components": components,
            "connections": connections_of(archive, flat, channels, names, fmus, description),
            "links": {name: archive.toml(name, toml) for name, toml in links.items()},
        }
        rest = archive.toml("scenario", description.rest)
        given = rest | archive.toml("signals", description.signals)
        data |= {key: value for key, value in given.items() if key not in data}
        by_name = {names[place]: fmu for place, fmu in fmus.items()}
        text, loaded = _parsed(data, path)
        keys_set = _cut_loops(data, loaded.scenario, by_name, archive.notes)
        if keys_set:
            text, loaded = _parsed(data, path)
        try:
            folder.mkdir(exist_ok=True)
            for file in files.values():
                (unpacked / file).replace(folder / file)
            write_whole(path, text.encode())
        except OSError as error:
            raise _unwritten(path, error) from error
    return SspImport(
        path=path,
        version=description.version,
        names={".".join(place): name for place, name in names.items()},
        connections=len(data["connections"]),
        links=tuple(loaded.scenario.links),
        fmus=tuple(sorted(f"{folder.name}/{file}" for file in files.values())),
        step_s=loaded.scenario.run.step,
        end_s=loaded.scenario.run.end,
        unsupported=tuple(archive.notes),
        only_here=tuple(ignored_by_others(rest, description.links)),
        keys_set=keys_set,
    )


def _without(flat: FlatSystem, elements: Collection[str]) -> FlatSystem:
    """Leave out elements whose signals the scenario gives, with their connections."""
    gone = {(element,) for element in elements}
    parts = {place: part for place, part in flat.parts.items() if place not in gone}
    return FlatSystem(parts, [wire for wire in flat.wires if wire.source[0] not in gone])


def _parsed(data: Mapping[str, Any], path: Path) -> tuple[str, LoadedScenario]:
    text = tomli_w.dumps(
        SCENARIO_FILE.stamped({key: value for key, value in data.items() if value})
    )
    return text, parse(text, name=path.stem, where=str(path), folder=path.resolve().parent)


def _cut_loops(
    data: dict[str, Any],
    scenario: ScenarioPart,
    fmus: Mapping[str, FmuDescription],
    notes: list[str],
) -> dict[str, str]:
    """Cut loops whose FMUs do not declare dependencies, as the tools do that write such archives.

    Returns the key that was set; empty where no loop needs it, or the archive says what to do.
    """
    key = "unknown_feedthrough"
    if scenario.run.unknown_feedthrough != "refuse" or scenario.run.solve:
        return {}
    run = scenario.run.model_copy(update={key: "previous"})
    try:
        system = assemble(scenario.model_copy(update={"run": run}), fmus, parameters={}).system
    except InputError:
        return {}  # what else keeps it from running is reported when it is run
    cut = receiving_order(system).cut
    if not cut:
        return {}
    data["run"][key] = "previous"
    listed = [f"{c.source} -> {c.target}" for c in cut[:_MOST_LISTED]]
    more = f", {len(cut) - _MOST_LISTED} more" if len(cut) > _MOST_LISTED else ""
    why = (
        f'run.{key} = "previous" is set: the FMUs of a loop do not declare which outputs depend on '
        f"which inputs; delayed by one step: {', '.join(listed)}{more}"
    )
    notes.append(why)
    data["description"] += f" {why}."
    return {f"run.{key}": "previous"}


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """Make a temporary folder beside the scenario: a refused archive leaves nothing behind."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = tempfile.TemporaryDirectory(prefix=".ssp-", dir=path.parent)
    except OSError as error:
        raise _unwritten(path, error) from error
    with folder as name:
        yield Path(name)


def _unwritten(path: Path, error: OSError) -> InputError:
    return InputError("the scenario cannot be written", where=str(path), got=str(error))


def _unpack(
    archive: Archive, flat: FlatSystem, places: list[Place], folder: Path
) -> dict[str, str]:
    """Write the FMUs; entry -> file name."""
    files: dict[str, str] = {}
    for entry in sorted({flat.parts[place].entry for place in places}):
        stem = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(entry).stem).strip("._") or "component"
        file, number = f"{stem}.fmu", 2
        while file.lower() in {other.lower() for other in files.values()}:
            file, number = f"{stem}_{number}.fmu", number + 1
        files[entry] = file
        archive.extract(entry, folder / file)
    return files


def _described(archive: Archive, entry: str, fmu: Path) -> FmuDescription:
    """Describe an FMU; an error names the entry of the archive."""
    try:
        return describe_fmu(fmu)
    except InputError as error:
        inside = (error.where or "").partition(f"{fmu}: ")[2]
        place = f"{entry}: {inside}" if inside else entry
        more = {"expected": error.expected, "got": error.got, "hint": error.hint}
        raise archive.wrong(error.what, place, **more) from error


def _run(
    archive: Archive,
    description: Description,
    fmus: Mapping[Place, FmuDescription],
    step: float | None,
    end: float | None,
) -> dict[str, Any]:
    table = {} if description.run is None else archive.toml("run", description.run)
    notes = archive.notes
    experiments = [fmu.model.experiment for fmu in fmus.values()]
    if "end" not in table:
        table["end"] = description.stop_s
        if description.start_s:
            table["start"] = description.start_s
    if end is None and table["end"] is None:
        stops = [float(e["stopTime"]) for e in experiments if e.get("stopTime")]
        if not stops:
            raise archive.wrong(
                "neither the archive nor its FMUs say when the run ends",
                SSD,
                expected="a DefaultExperiment with a stopTime",
                hint="`end` SECONDS",
            )
        table["end"] = max(stops)
        notes.append(f"no stop time: {table['end']:g} s is from its FMUs' default experiments")
    if end is not None:
        table["end"] = end
    if "step" not in table and step is None:
        steps = [float(e["stepSize"]) for e in experiments if e.get("stepSize")]
        table["step"] = description.step_s
        if table["step"] is None:
            table["step"] = min(steps) if steps else table["end"] / 1000
            notes.append(
                f"SSP has no communication step: {table['step']:g} s is "
                + ("the least of its FMUs' default experiments" if steps else "end / 1000")
            )
    if step is not None:
        table["step"] = step
    return table
