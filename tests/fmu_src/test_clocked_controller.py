"""The controller with a Clock: the bits of the sampled one, in the same scenario."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, instantiate_fmu, read_model_description
from shared import fmu_store

from cosim.core import InputError
from cosim.fmu import build_fmu, describe_fmu
from cosim.fmu.inspect import inspect_fmu
from cosim.scenario import FmuCache, execute_run, load, prepare
from cosim.trace import Table, Trace

TOPICS = ("/plant/output", "/plant/input", "/controller/output", "/controller/input")


@pytest.fixture(scope="module")
def clocked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clocked controller of the paper's example."""
    folder = tmp_path_factory.mktemp("clocked")
    return build_fmu("PaperController", folder, "native-fmi3", clocked=True)


def rows_of(folder: Path, *settings: str) -> dict[str, Table]:
    """The rows of the paper's example, by topic."""
    loaded = load("paper-example", ["run.end=3.0", *settings])
    prepared = prepare(loaded, FmuCache(fmu_store("native"), loaded.folder, "native"))
    path = folder / f"run{len(list(folder.glob('*.mcap')))}.mcap"
    assert execute_run(prepared, path).status == "finished"
    return {topic: Trace(path).read(topic) for topic in TOPICS}


@pytest.mark.parametrize("step", ["0.01", "0.02"])
def test_clocked_controller_gives_the_bits_of_the_sampled_one(
    tmp_path: Path, clocked: Path, step: str
) -> None:
    """At every point of the sampled run, once events are over; and its Clock ticks exactly."""
    parameters = "components.controller.parameters.sample_time=0.04"
    settings = (f"run.step={step}", parameters)
    one = rows_of(tmp_path, *settings)
    other = rows_of(tmp_path, *settings, f"components.controller.fmu='{clocked}'")
    ticks = other["/controller/input"].log_time_ns[other["/controller/input"]["clock"]]
    assert ticks.tolist() == [40_000_000 * k for k in range(76)]
    for topic, rows in one.items():
        times = other[topic].log_time_ns
        last = np.searchsorted(times, rows.log_time_ns, side="right") - 1
        assert (times[last] == rows.log_time_ns).all()
        for name, column in rows.columns.items():
            assert column.tobytes() == other[topic].columns[name][last].tobytes(), (topic, name)
    assert np.abs(one["/controller/output"]["u[1]"]).max() > 0.01


def test_clocked_controller_without_event_mode_is_the_sampled_one(
    tmp_path: Path, clocked: Path
) -> None:
    """Row by row."""
    period = "components.controller.parameters.sample_time=0.04"
    one = rows_of(tmp_path, period)
    given = (f"components.controller.fmu='{clocked}'", "components.controller.event_mode=false")
    other = rows_of(tmp_path, period, *given)
    for topic, rows in one.items():
        assert {n: c.tobytes() for n, c in rows.columns.items()} == {
            n: c.tobytes() for n, c in other[topic].columns.items()
        }


def test_clock_is_declared_as_the_standard_has_it(clocked: Path) -> None:
    """A fixed Clock whose interval is the parameter; inputs are clocked and discrete; no error."""
    port = describe_fmu(clocked).ports["clock"]
    assert port.clock is not None
    assert (port.clock.variability, port.clock.interval, port.causality) == ("fixed", None, "input")
    inputs = [p for p in describe_fmu(clocked).ports.values() if p.causality == "input"]
    assert all(p.clocks == ("clock",) for p in inputs if p is not port)
    assert [f for f in inspect_fmu(clocked).findings if f.level == "error"] == []


@pytest.mark.parametrize("component", ["PaperController", "HinfController"])
def test_clocked_controllers_fly_with_their_defaults(tmp_path: Path, component: str) -> None:
    """Their Clock has a period; another importer may ask whether it ticks."""
    fmu = build_fmu(component, tmp_path, "native-fmi3", clocked=True)
    text = f'title = "t"\n[run]\nend = 0.2\nstep = 0.01\n[components.c]\nfmu = "{fmu}"\n'
    (tmp_path / "t.toml").write_text(text, "utf-8")
    prepared = prepare(load(str(tmp_path / "t.toml")), FmuCache(tmp_path, tmp_path))
    path = tmp_path / "t.mcap"
    assert execute_run(prepared, path).status == "finished"
    period = describe_fmu(fmu).ports["sample_time"].start
    rows = Trace(path).read("/c/input")
    assert rows.log_time_ns[rows["clock"]].tolist() == [
        round(k * period * 1e9) for k in range(round(0.2 / period) + 1)
    ]
    model = read_model_description(str(fmu))
    clock = next(v for v in model.modelVariables if v.name == "clock").valueReference
    slave = instantiate_fmu(extract(str(fmu), str(tmp_path / "unpacked")), model, "CoSimulation")
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    assert slave.getClock([clock]) == [False]
    slave.freeInstance()


def test_sample_time_of_zero_is_no_interval(tmp_path: Path, clocked: Path) -> None:
    """Which samples at every point without a Clock."""
    with pytest.raises(Exception, match=r"interval of clock|sample_time of more than 0"):
        rows_of(
            tmp_path,
            f"components.controller.fmu='{clocked}'",
            "components.controller.parameters.sample_time=0.0",
        )


@pytest.mark.parametrize(
    ("component", "flavour"), [("AuvPlant", "native-fmi3"), ("PaperController", "native")]
)
def test_what_has_no_clock_is_refused(tmp_path: Path, component: str, flavour: str) -> None:
    """A plant is not sampled, and FMI 2.0 has no Clocks."""
    with pytest.raises(InputError, match="this FMU has no Clock"):
        build_fmu(component, tmp_path, flavour, clocked=True)
