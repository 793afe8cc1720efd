"""Exported archives in OMSimulator, as they are; skipped where the program is not on the PATH."""

from __future__ import annotations

import csv
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from shared import sampled

from cosim.master import simulate
from cosim.scenario import (
    FmuCache,
    SspVersion,
    assembled_system,
    builtin_names,
    export_ssp,
    import_ssp,
    load,
    parse,
    prepare,
)

PROGRAM = shutil.which("OMSimulator")
TOLERANCE = 1e-10
"""Of each signal's size: the program writes 12 digits."""

VARYING = {"acoustic-range"}
"""Scenarios that have no link FMUs: a link FMU has a constant delay."""

pytestmark = [
    pytest.mark.skipif(PROGRAM is None, reason="OMSimulator is not installed"),
    pytest.mark.slow,
]


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("name", sampled(sorted(set(builtin_names()) - VARYING), 2))
def test_archive_runs_unedited_as_here(
    native_fmus: Path, tmp_path: Path, name: str, version: SspVersion
) -> None:
    """Every output of every component at every point, events left out on both sides."""
    text = load(name).text.replace('events = "align"', 'events = "grid"')
    loaded = parse(text, name=name, where=f"{name}.toml", folder=tmp_path)
    prepared = prepare(loaded, FmuCache(native_fmus.parent, tmp_path, flavour="native"))
    done = export_ssp(prepared, tmp_path / f"{name}.ssp", "fmu", version)
    results = tmp_path / "results.csv"
    ran = subprocess.run(  # noqa: S603 - on our own archive
        [str(PROGRAM), done.path.name, f"--resultFile={results}", f"--stopTime={done.end_s}"],
        cwd=tmp_path,
        check=False,
        capture_output=True,
        text=True,
    )
    assert "error:" not in ran.stdout + ran.stderr
    rows = np.genfromtxt(results, delimiter=",", skip_header=1)
    with results.open() as file:
        header = next(csv.reader(file))
    run = simulate(assembled_system(prepared)[0])
    place = {round(t / done.step_s): i for i, t in enumerate(rows[:, 0])}  # the last of an instant
    theirs = [place[k] for k in range(1, run.points_ns.size)]
    names = import_ssp(done.path, tmp_path / "again.toml").names
    plain = {name: element for element, name in names.items()}
    outer = ".".join(header[1].split(".")[:2])
    compared = 0
    for component, fmu in prepared.fmus.items():
        for port in fmu.ports.values():
            column = f"{outer}.{plain[component]}.{port.name}"
            if port.causality == "output" and port.kind == "float":
                ours = run.signal(component, port.name)[1:]
                found = rows[theirs, header.index(column)]
                scale = max(1.0, float(np.abs(ours).max()))
                assert np.abs(ours - found).max() <= TOLERANCE * scale, column
                compared += 1
    assert compared > 3
