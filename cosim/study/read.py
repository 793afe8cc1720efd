"""Load a study by name or from a file, with the scenario that it varies."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from cosim.core import STUDY_FILE, InputError, validated
from cosim.scenario import LoadedScenario, builtin_names, load, parse, read_text
from cosim.study.consistency import Place, check_certified, check_consistent, in_file
from cosim.study.folder import MANIFEST, read_manifest
from cosim.study.schema import Study


@dataclass(frozen=True)
class LoadedStudy:
    """A study, its name (built-in, or the file's stem), text and file (`where`), its scenario.

    digest : of the results in its folder, if it was loaded from one.
    """

    name: str
    study: Study
    text: str
    where: str
    base: LoadedScenario
    digest: str | None = None

    @property
    def place(self) -> Place:
        """Gives the place of a key in the file."""
        return in_file(self.text, self.where)


def builtin_studies() -> list[str]:
    """Return the names of the built-in studies.

        >>> from cosim.study import builtin_studies
        >>> "delay-margin" in builtin_studies()
        True

    `load_study` and `run_study` take them.
    """
    library = files("cosim.study").joinpath("library")
    return sorted(
        p.name.removesuffix(".toml") for p in library.iterdir() if p.name.endswith(".toml")
    )


def load_study(name_or_path: str) -> LoadedStudy:
    """Load a built-in study by name, a TOML file by path, or the study of a folder of results.

        >>> from cosim.study import load_study
        >>> loaded = load_study("delay-margin")
        >>> [axis.column for axis in loaded.study.vary], "stable" in loaded.study.metrics
        (['delay'], True)

    Raises
    ------
    InputError : no such study, malformed TOML, a study that breaks the schema, or a scenario
        that cannot be read.
    """
    names = builtin_studies()
    if name_or_path not in names and Path(name_or_path, MANIFEST).is_file():
        return _of_folder(Path(name_or_path))
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
    check_certified(study, in_file(text, where))
    named = study.scenario
    if named not in builtin_names() and named.endswith(".toml"):
        named = str(path.resolve().parent / named)
    return LoadedStudy(path.stem, study, text, where, load(named))


def _of_folder(folder: Path) -> LoadedStudy:
    """Load the study and the scenario whose results a folder has."""
    manifest = read_manifest(folder)
    scenario, where = manifest["scenario"], str(folder / MANIFEST)
    place = manifest.get("scenario_folder")
    if scenario["name"] in builtin_names() and load(scenario["name"]).text == scenario["text"]:
        base = load(scenario["name"])
    elif place is None or not Path(place).is_dir():
        raise InputError(
            "the folder of the study's scenario is not here",
            where=where,
            expected="scenario_folder, from where the scenario's FMUs are found",
            got=str(place),
            hint="give the study's file instead of the folder of its results",
        )
    else:
        base = parse(scenario["text"], name=scenario["name"], where=where, folder=Path(place))
    study = Study.model_validate(manifest["study"])
    return LoadedStudy(folder.resolve().name, study, "", where, base, manifest["digest"])
