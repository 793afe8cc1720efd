"""Load a study by name or from a file, with the scenario that it varies."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from cosim.core import STUDY_FILE, InputError
from cosim.scenario import LoadedScenario, builtin_names, load, read_text, validated
from cosim.study.consistency import Place, check_consistent, in_file
from cosim.study.schema import Study


@dataclass(frozen=True)
class LoadedStudy:
    """A study, its name (built-in, or the file's stem), text and file (`where`), its scenario."""

    name: str
    study: Study
    text: str
    where: str
    base: LoadedScenario

    @property
    def place(self) -> Place:
        """Gives the place of a key in the file."""
        return in_file(self.text, self.where)


def builtin_studies() -> list[str]:
    """Return the names of the built-in studies."""
    library = files("cosim.study").joinpath("library")
    return sorted(
        p.name.removesuffix(".toml") for p in library.iterdir() if p.name.endswith(".toml")
    )


def load_study(name_or_path: str) -> LoadedStudy:
    """Load a built-in study by name, or a TOML file by path, and the scenario it names.

    Raises
    ------
    InputError : no such study, malformed TOML, a study that breaks the schema, or a scenario
        that cannot be read.
    """
    names = builtin_studies()
    if name_or_path in names:
        path = Path(str(files("cosim.study").joinpath("library", f"{name_or_path}.toml")))
        where = path.name
    else:
        path, where = Path(name_or_path), name_or_path
        if path.suffix != ".toml" and not path.exists():
            hint = "cosim study list shows them; scenarios: cosim scenario list"
            raise InputError.unknown("study", name_or_path, [*names, "FILE.toml"], hint=hint)
    text = read_text(path)
    data = STUDY_FILE.from_toml(text, where)
    study = validated(Study, text, data, where)
    check_consistent(study, in_file(text, where))
    named = study.scenario
    if named not in builtin_names() and named.endswith(".toml"):
        named = str(path.resolve().parent / named)
    return LoadedStudy(path.stem, study, text, where, load(named))
