"""The FMUs that the falsifier flies: made once from pinned designs and system files.

The designs are kept beside this file, so that a solver's last digits never decide a cell;
`python -m tests.falsifier.parts` makes them again, for a change of what a design says.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, cast

import tomli_w

from cosim import run
from cosim.fmu import export as fmu

HERE = Path(__file__).parent
SYSTEMS, DESIGNS = HERE / "systems", HERE / "designs"
GIVEN = {"least": ([[1.0, 0.0]], 1), "sampled": ([[1.0, 0.0]], 1), "exact": ([[0.0, -0.02]], 2)}
"""Gains that are analysed, in which order: plants that are stable in a window of ages alone."""
LIMIT = 1000.0
"""Bound on the command of the kind with limits, which no flight as designed reaches."""


def names() -> list[str]:
    """The designs, by name."""
    return sorted(path.stem for path in SYSTEMS.glob("*.toml"))


def make_parts_of(data: Any, folder: Path) -> None:
    """Make what a scenario names and is not in the folder yet: designs and FMUs of theirs."""
    wanted = {part["fmu"] for part in data["components"].values()}
    wanted |= {str(x) for x in data.get("design", {}).values() if isinstance(x, str)}
    for name in sorted(wanted):
        if (SYSTEMS / name).exists() or (DESIGNS / name).exists():
            source = (SYSTEMS if name.endswith(".toml") else DESIGNS) / name
            text, target = source.read_text("utf-8"), folder / name
            if not target.exists() or target.read_text("utf-8") != text:  # others may read it now
                target.write_text(text, "utf-8")
        elif name.endswith(".fmu") and not (folder / name).exists():
            _make_fmu(folder / name)


def _make_fmu(target: Path) -> None:
    """NAME-plant.fmu, NAME-controller.fmu, or either with -FLAVOUR behind it."""
    name, what, *flavour = target.stem.split("-", 2)
    flavour_name = cast("fmu.Flavour", flavour[0] if flavour else "native")
    kind = fmu.target_named(flavour_name, "prebuilt")
    if what == "plant":
        fmu.export_plant(str(SYSTEMS / f"{name}.toml"), target, kind=kind)
        return
    limits = [LIMIT] if name == "limited" else None
    of = "any" if name == "limited" else name
    design = json.loads((DESIGNS / f"{of}.json").read_text("utf-8"))
    fmu.export_controller(design, target, where=of, kind=kind, limits=limits)


def make_designs() -> None:
    """Design every system again with today's code, or analyse the gain given for it."""
    for name in names():
        system, saved = SYSTEMS / f"{name}.toml", DESIGNS / f"{name}.json"
        if name in GIVEN:
            saved.write_text(json.dumps(_analysed(name)), "utf-8")
        else:
            words = ["design", str(system), "--save", str(saved)]
            subprocess.run(  # noqa: S603 - our own command
                [sys.executable, "-m", "cosim", *words], check=True
            )


def _analysed(name: str) -> Any:
    """The design that a run keeps beside its scenario, of a gain that stands there."""
    gain, order = GIVEN[name]
    with tempfile.TemporaryDirectory(prefix="falsifier-") as folder:
        path = Path(folder, "case.toml")
        data = {
            "title": name,
            "run": {"end": 0.1, "step": 0.1},
            "components": {
                "plant": {"fmu": f"{name}-plant.fmu"},
                "controller": {"fmu": "PaperController"},
            },
            "connect": ["plant.x -> controller.x", "controller.u -> plant.u"],
            "design": {"system": f"{name}.toml", "gain": gain, "order": order},
        }
        make_parts_of(data, path.parent)
        path.write_text(tomli_w.dumps(data), "utf-8")
        run(path, fmus=Path(folder, "fmus"))
        return json.loads(Path(folder, "case.design.json").read_text("utf-8"))


if __name__ == "__main__":
    make_designs()
