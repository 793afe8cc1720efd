"""`extends = "auv-acoustic"`: a scenario that contains only its differences from another one.

Tables are merged key by key, to any depth; everything else, including lists, is replaced. A
table whose `kind` changes is replaced whole, and so are the connections, whichever of their two
forms (`connections`, `connect`) the extending scenario uses. `without = ["reference",
"links.uplink"]` removes parts of the base. In [design], a `file` and the keys that a design is
made from replace each other (`give_way`).
"""

from __future__ import annotations

import copy
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from cosim.core import SCENARIO_FILE, InputError, Layer, Origin, unreadable
from cosim.scenario.built_in import builtin_names
from cosim.scenario.copies import written_out
from cosim.scenario.key_paths import remove, split
from cosim.scenario.schema import MADE_WITH

_INSTEAD_OF_FILE = (*MADE_WITH, "state_delay", "loop_delay", "least_age", "rate", "sampled")
_ASKED = {*_INSTEAD_OF_FILE, "system", "damping", "position_weight", "envelope"}
_CONNECTIONS = ("connections", "connect")
_MOST = 32


@dataclass(frozen=True)
class Source:
    """A scenario before it is validated.

    Attributes
    ----------
    name : the built-in name, or the file's stem.
    data : the TOML values, `extends` resolved.
    layers : the files it was merged from, the base first.
    folder : start of relative paths.
    file : the user's file; None if it was not read from one.
    """

    name: str
    data: dict[str, Any]
    layers: tuple[Layer, ...]
    folder: Path
    file: Path | None = None

    @property
    def text(self) -> str:
        """Text of the file itself."""
        return self.layers[-1].text

    def written_out(self) -> tuple[dict[str, Any], Origin]:
        """Return the data with all copies made, and what locates its parts; see `copies`."""
        return written_out(self.data, Origin(self.layers))


def read_text(path: Path) -> str:
    """Return the text of a file that a user named; an `InputError` if it cannot be read."""
    try:
        return path.read_text("utf-8")
    except (OSError, ValueError) as error:  # ValueError: no UTF-8, a null in the path
        raise unreadable(path, error, expected="a text file") from error


def open_source(name_or_path: str, *, relative_to: Path | None = None) -> Source:
    """Open a built-in scenario by name, or a TOML file by path, merged with what it extends.

    Raises
    ------
    InputError : no such scenario, malformed TOML, a cycle.
    """
    names = builtin_names()
    if name_or_path in names:
        return _builtin(name_or_path, Path.cwd())
    path = Path(name_or_path) if relative_to is None else relative_to / name_or_path
    if path.suffix != ".toml" and not (path.exists() and path.suffix not in _OTHER_FILES):
        raise _unknown(name_or_path, path)
    return _from_file(path)


_OTHER_FILES = {
    ".fmu": "an FMU is a component of a scenario: cosim scenario new writes one to change; "
    "cosim fmu check {file} --run runs the FMU alone",
    ".mcap": "a trace is run again by cosim trace rerun {file}",
    ".json": 'a design is named by a scenario: [design] file = "{file}"',
    ".ssp": "cosim ssp import {file} makes a scenario of an SSP archive",
}
"""Files that are no scenarios, and what to do with them."""


def _unknown(name: str, path: Path, where: str | None = None) -> InputError:
    """Return the error for a name that is neither a built-in scenario nor a file of one."""
    file = path.with_name(f"{path.name}.toml")
    hint = _OTHER_FILES.get(
        path.suffix, "cosim scenario list shows them; studies: cosim study list"
    )
    if file.is_file():
        hint = f"did you mean {name}.toml?"
    known = [*builtin_names(), "FILE.toml"]
    return InputError.unknown("scenario", name, known, where=where, hint=hint.format(file=name))


def _builtin(name: str, folder: Path, chain: tuple[str, ...] = ()) -> Source:
    file = files("cosim.scenario").joinpath("library", f"{name}.toml")
    text = file.read_text("utf-8")
    return source_of(text, name=name, where=f"{name}.toml", folder=folder, chain=chain)


def _from_file(path: Path, chain: tuple[str, ...] = ()) -> Source:
    text, folder = read_text(path), path.resolve().parent
    return source_of(text, name=path.stem, where=str(path), folder=folder, file=path, chain=chain)


def source_of(
    text: str,
    *,
    name: str,
    where: str,
    folder: Path,
    file: Path | None = None,
    chain: tuple[str, ...] = (),
) -> Source:
    """Read the text of a scenario and merge it with what it extends; `chain`: extended by."""
    own = SCENARIO_FILE.from_toml(text, where)
    layer = Layer(where, text)
    base_name = own.pop("extends", None)
    without = own.pop("without", None)
    if base_name is None and without is None:
        return Source(name, own, (layer,), folder, file)
    at = f"{where}:{_line(text)}: extends"
    if not isinstance(base_name, str):
        raise InputError(
            "extends must be a text"
            if base_name is not None
            else "without removes parts of the extended scenario, and this one extends nothing",
            where=at,
            expected='extends = "auv-acoustic", or the path of a file',
            got=None if base_name is None else repr(base_name),
        )
    here = str(file.resolve()) if file is not None else name
    chain = (*chain, here)
    base = _base(base_name, folder, chain, at)
    data = _rebased(base, folder)
    for path in _paths(without, at):
        remove(data, split(path), f"{where}: without {path}")
    return Source(name, merged(data, own), (*base.layers, layer), folder, file)


def _base(name: str, folder: Path, chain: tuple[str, ...], at: str) -> Source:
    names = builtin_names()
    file = None if name in names else folder / name
    own = name if file is None else str(file.resolve())
    if own in chain or len(chain) > _MOST:
        cycle = (*chain[chain.index(own) :], own) if own in chain else (*chain[:4], "...")
        raise InputError(
            "scenarios extend each other in a cycle",
            where=at,
            got=" -> ".join(Path(link).name for link in cycle),
            hint="one of them must not extend another",
        )
    if file is None:
        return _builtin(name, folder, chain)
    if not file.is_file():
        raise _unknown(name, file, at)
    return _from_file(file, chain)


def _paths(without: Any, at: str) -> list[str]:
    if without is None:
        return []
    if not isinstance(without, list) or not all(isinstance(p, str) for p in without):
        raise InputError(
            "without must be a list of keys",
            where=at.replace("extends", "without"),
            expected='without = ["reference", "links.uplink"]',
            got=repr(without)[:100],
        )
    return without


def _line(text: str) -> int:
    lines = text.splitlines()
    return next((i + 1 for i, line in enumerate(lines) if line.lstrip().startswith("extends")), 1)


def merged(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Merge the tables of a scenario into those of its base."""
    data = copy.deepcopy(dict(base))
    if any(key in own for key in _CONNECTIONS):
        for key in _CONNECTIONS:
            data.pop(key, None)
    if isinstance(own.get("design"), dict):
        give_way(data, own["design"])
    return _merged(data, own)


def give_way(data: Mapping[str, Any], keys: Collection[str]) -> None:
    """Remove from the [design] of `data` what these keys of a later [design] replace.

    A `file` replaces the delays and the keys for making a design; these, and keys that describe
    the system, replace a `file`: then a new design is made.
    """
    design = data.get("design")
    if not isinstance(design, dict):
        return
    gone = _INSTEAD_OF_FILE if "file" in keys else ("file",) if set(keys) & _ASKED else ()
    for key in set(gone) - set(keys):
        design.pop(key, None)


def _merged(base: dict[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    for key, value in own.items():
        before = base.get(key)
        if (
            isinstance(before, dict)
            and isinstance(value, dict)
            and before.get("kind") == value.get("kind", before.get("kind"))
        ):
            base[key] = _merged(before, value)
        else:
            base[key] = copy.deepcopy(value)
    return base


def _rebased(base: Source, folder: Path) -> dict[str, Any]:
    """Return the base's data with its relative paths rewritten for another folder."""
    data = copy.deepcopy(base.data)
    if base.folder == folder:
        return data

    def seen(path: Any, *suffixes: str) -> Any:
        if not isinstance(path, str) or not path.endswith(suffixes) or Path(path).is_absolute():
            return path
        return Path(os.path.relpath(base.folder / path, folder)).as_posix()

    loops = data.get("for")
    for table in (data, *(loops if isinstance(loops, list) else ())):
        components = table.get("components") if isinstance(table, dict) else None
        for part in components.values() if isinstance(components, dict) else ():
            if isinstance(part, dict) and "fmu" in part:
                part["fmu"] = seen(part["fmu"], ".fmu")
    design = data.get("design")
    for key, suffixes in (("system", (".toml",)), ("file", (".json", ".fmu"))):
        if isinstance(design, dict) and key in design:
            design[key] = seen(design[key], *suffixes)
    return data
