"""Makes the files that are kept in tests/corpus: what one version of this project wrote.

PYTHONPATH=tests python -m corpus.make FOLDER [--keep]

Everything is made in FOLDER, from the systems, scenarios and studies beside this file, by the
commands of `CASES` in their order. With --keep what is not kept yet is packed and copied here; a
file that is here already is left alone: it stands for the version that wrote it.
"""

from __future__ import annotations

import argparse
import json
import lzma
import platform
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from unittest.mock import patch

from cli.shell import cosim
from corpus.files import HERE, PACKED, SOURCES
from foreign.c_fmu import c_fmu, every
from foreign.steered import steered_fmu
from vehicle.vehicle_files import EVERY_TERM

from cosim.fmu import build_fmu
from cosim.master import TraceRecorder
from cosim.scenario import FmuCache, ScenarioSession, assembled_system, load, prepare
from cosim.trace import TraceWriter
from cosim.trace.rows import result_of_link

LIBRARY = HERE.parents[1] / "cosim" / "scenario" / "library" / "designs"
DESIGNED = (
    *("any", "blocks", "constant", "integral", "least", "limited", "own-delay", "rate"),
    *("sampled", "single-states", "stability", "two-delays", "weighted"),
    *("observer", "observer-exact", "observer-peaks", "observer-plant-delay", "observer-sampled"),
)
"""Systems that are designed for as their files say; the certificate has the name of the system."""

RUN_FROM_FILES = tuple(sorted(path.stem for path in (HERE / "scenarios").glob("*.toml")))
REFUSED = ("constant-exactly", "rate")
"""Scenarios that are refused: their designs are about ages that no run has."""

HOST, F, C = "--platforms host", "fmus", "certificates"
CASES: tuple[tuple[str, str], ...] = (
    *((f"{C}/{name}.json", f"design systems/{name}.toml --save") for name in DESIGNED),
    (f"{C}/constant-up-to.json", "design systems/constant.toml --order theorem-2 --save"),
    (f"{C}/theorem-2-limits.json", "design systems/limited.toml --order theorem-2 --save"),
    (f"{C}/outages.json", "design systems/any.toml --outages --save"),
    (f"{C}/theorem-1.json", "analyse systems/own-delay.toml --gain [[-3,-3]] --order 0 --save"),
    (f"{C}/order-2.json", "analyse systems/own-delay.toml --gain [[-3,-3]] --order 2 --save"),
    (f"{C}/norm.json", "analyse systems/own-delay.toml --gain [[-3,-3]] --order 0 --save-norm"),
    (
        f"{C}/refutation.json",
        "design systems/own-delay.toml --k1 0.6 --k2 0.2 --gamma 0.01 --save-refutation",
    ),
    (
        f"{C}/gamma-floor.json",
        "design paper --k1 0.6 --k2 0.2 --gamma 4.9 --order theorem-2 --save-refutation",
    ),
    (f"{F}/pendulum.fmu", f"fmu build systems/any.toml {HOST} --out"),
    (f"{F}/pendulum-fmi3.fmu", f"fmu build systems/any.toml --flavour native-fmi3 {HOST} --out"),
    (f"{F}/plant-delay.fmu", f"fmu build systems/observer-plant-delay.toml {HOST} --out"),
    (f"{F}/window.fmu", f"fmu build systems/observer-exact.toml {HOST} --out"),
    (f"{F}/nps-auv2.fmu", f"fmu build nps-auv2 {HOST} --out"),
    *(
        (f"{F}/{name}.fmu", f"fmu controller {C}/{of}.json --sample-time {options} {HOST} --out")
        for name, of, options in (
            ("any-controller", "any", "0.01"),
            ("any-controller-fmi3", "any", "0.01 --flavour native-fmi3"),
            ("any-controller-clocked", "any", "0.05 --flavour native-fmi3 --clocked"),
            ("any-controller-watched", "any", "0.01 --watch --envelope 1,0"),
            ("integral-controller", "integral", "0.01"),
            ("theorem-2-controller", "stability", "0.01 --limits 5"),
            ("observer-controller", "observer", "0.01"),
            ("observer-alone", "observer", "0.01 --observer"),
            ("plant-delay-controller", "observer-plant-delay", "0.01"),
            ("exact-controller", "observer-exact", "0.01"),
        )
    ),
    (
        f"{F}/any-controller-python.fmu",
        f"fmu controller {C}/any.json --sample-time 0.01 --flavour python --out",
    ),
    ("traces/loop.mcap", "run scenarios/loop.toml --fmus store --out"),
    ("links/uplink.csv", "link record traces/loop.mcap --link uplink --out"),
    *(
        (f"traces/{name}.mcap", f"run scenarios/{name}.toml --fmus store --out")
        for name in RUN_FROM_FILES
        if name not in (*REFUSED, "loop")
    ),
    ("links/outages.csv", "link record traces/outages.mcap --link uplink --out"),
    ("traces/stopped.mcap", "run scenarios/loop.toml --until 1 --fmus store --out"),
    ("traces/rerun.mcap", "trace rerun traces/loop.mcap --fmus . --out"),
    (
        "traces/injected.mcap",
        f"trace inject traces/loop.mcap --into {F}/any-controller.fmu --compare controller --out",
    ),
    ("ssp/loop-annotate.ssp", "ssp export scenarios/loop.toml --links annotate --out"),
    ("ssp/loop-fmu.ssp", "ssp export scenarios/loop.toml --links fmu --out"),
    ("ssp/native-fmi3.ssp", "ssp export scenarios/native-fmi3.toml --ssp 2.0 --out"),
    ("results/half", "study run studies/delays.toml --time-limit 0.25 --fmus store --out"),
    ("results/part-1", "study run studies/delays.toml --runs 0:3 --fmus store --out"),
    ("results/part-2", "study run studies/delays.toml --runs 3:8 --fmus store --out"),
    ("results/done", "study run studies/delays.toml --fmus store --out"),
    ("flight", "vehicle fly vehicles/nps-auv2.toml --link 1s --duration 10s --fmus store --out"),
    ("traces/flight.mcap", "run flight/scenario.toml --until 2 --fmus store --out"),
)
"""File (or folder), and the words of `cosim` that make it, with the file as the last one."""

EXPECTED = {
    **dict.fromkeys((f"{C}/refutation.json", f"{C}/gamma-floor.json"), 5),  # not achievable
    "traces/assertion-fails.mcap": 1,
    "traces/component-fails.mcap": 4,
    "results/half": 3,  # runs are left
}
"""Exit codes that are not 0."""


LEFT_OUT = ("flight/flight.png", "flight/flight.mcap")
"""Large, and no other than what is kept elsewhere."""


def every_type(folder: Path) -> None:
    """An FMU of FMI 3.0 in C with variables of every type."""
    with tempfile.TemporaryDirectory() as place:
        shutil.copy(c_fmu("every_fmi3.c", every(), Path(place)), folder / F / "every-type.fmu")


def steered(folder: Path) -> None:
    """An FMU of FMI 2.0 in C whose calls fail as its parameters say."""
    with tempfile.TemporaryDirectory() as place:
        shutil.copy(steered_fmu(Path(place), "2.0"), folder / F / "steered.fmu")


def store(folder: Path) -> None:
    """The native FMUs of the catalogue that the scenarios name, for this machine."""
    for name in ("AuvPlant", "HinfController", "Sensor", "WaveField"):
        build_fmu(name, folder / "store" / "native", "native")


def auv(folder: Path) -> None:
    """The design of the built-in scenario auv-acoustic."""
    shutil.copy(LIBRARY / "auv-1.25s.json", folder / C / "auv.json")


def not_proved(folder: Path) -> None:
    """A gamma that is smaller than the proved one, claimed throughout."""
    data = json.loads((folder / C / "constant-up-to.json").read_text("utf-8"))
    data["claim"]["gamma"] = data["variables"]["gamma"] = "1/100"
    (folder / C / "not-proved.json").write_text(json.dumps(data), "utf-8")


def vehicles(folder: Path) -> None:
    """A vehicle of the gallery, and one with every term there is."""
    (folder / "vehicles").mkdir()
    text = cosim("vehicle", "show", "nps-auv2", "--source", cwd=folder).out
    (folder / "vehicles" / "nps-auv2.toml").write_text(text, "utf-8")
    (folder / "vehicles" / "every-term.toml").write_text(EVERY_TERM, "utf-8")


def session(folder: Path) -> None:
    """The loop as a session that somebody disturbs, recorded row by row."""
    loaded = load(str(folder / "scenarios" / "loop.toml"))
    system, events = assembled_system(prepare(loaded, FmuCache(folder / "store", loaded.folder)))
    with TraceWriter(folder / "traces" / "session.mcap", run={"title": "A session"}) as writer:
        with ScenarioSession(system, events, [TraceRecorder(writer, system)]) as run:
            run.run_until(0.5)
            run.bias("controller", "x[1]", 0.05)
            run.run_until(1.0)
            done = run.result(complete=True)
        of_links = [result_of_link(name, of) for name, of in done.statistics.items()]
        writer.finish({"status": done.status, **{k: v for of in of_links for k, v in of.items()}})


def cut(folder: Path) -> None:
    """The first two thirds of a trace, as a crash leaves them, and what is recovered of them."""
    whole = (folder / "traces" / "auv.mcap").read_bytes()
    (folder / "traces" / "cut.mcap.partial").write_bytes(whole[: 2 * len(whole) // 3])
    words = ("traces/cut.mcap.partial", "--out", "traces/recovered.mcap")
    assert cosim("trace", "recover", *words, cwd=folder).code == 3


BEFORE: dict[str, Callable[[Path], None]] = {
    "certificates/auv.json": auv,
    "fmus/every-type.fmu": every_type,
    "fmus/steered.fmu": steered,
    "store": store,
    "vehicles": vehicles,
}
AFTER: dict[str, Callable[[Path], None]] = {
    "certificates/not-proved.json": not_proved,
    "traces/session.mcap": session,
    "traces/cut.mcap.partial": cut,
}
"""What no command makes, by a function, before and after the commands."""


def make(folder: Path) -> None:
    """Make what is not there yet in a folder, everything in one that is empty."""
    for name in SOURCES:
        shutil.copytree(HERE / name, folder / name, dirs_exist_ok=True)
    for name in (C, F, "traces", "links", "ssp"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    _by_functions(BEFORE, folder)
    for name, words in CASES:
        if (folder / name).exists():
            continue
        result = cosim(*words.split(), name, cwd=folder)
        assert result.code == EXPECTED.get(name, 0), (name, result)
        print(f"{name}: cosim {words} {name}")  # noqa: T201 - a script
    _by_functions(AFTER, folder)


def _by_functions(steps: Mapping[str, Callable[[Path], None]], folder: Path) -> None:
    for name, step in steps.items():
        if not (folder / name).exists():
            step(folder)


def keep(folder: Path) -> None:
    """Copy to this folder what it does not have yet, large binaries packed."""
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder)
        packed = any(name.match(pattern.removesuffix(".xz")) for pattern in PACKED)
        target = HERE / (f"{name}.xz" if packed else name)
        if target.exists() or name.name == ".lock" or str(name) in LEFT_OUT:
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        content = path.read_bytes()
        target.write_bytes(lzma.compress(content, preset=9) if packed else content)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--keep", action="store_true")
    given = parser.parse_args()
    # which numbers come out depends on the C library, not on the kernel of a machine
    machine = "-".join((platform.system(), platform.machine(), *platform.libc_ver()))
    with patch("platform.platform", lambda: machine):
        make(given.folder.resolve())
    if given.keep:
        keep(given.folder.resolve())
