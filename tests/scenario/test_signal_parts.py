"""Computed values, sensors, maps on connections and time series against closed forms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import build_fmu
from cosim.fmu.export import component_module
from cosim.master import Run
from cosim.network import standard_normal
from cosim.scenario import FmuCache, execute_unrecorded, parse, prepare

Reals = NDArray[np.float64]

HEAD = """\
title = "signals"

[run]
end = 2.0
step = 0.05
seed = 7

[components.plant]
fmu = "AuvPlant"

[components.controller]
fmu = "HinfController"

"""
SOURCE = """\
[computed.source]
x = "2 m/s * t"
y = "1 m * sin(3 rad/s * t)"

"""


def ran(text: str, fmus: Path, folder: Path, **options: Any) -> Run:
    """The run of HEAD and a text."""
    loaded = parse(HEAD + text, name="signals", where="signals.toml", folder=folder)
    cache = FmuCache(fmus.parent, folder, flavour=options.pop("flavour", "native"))
    return execute_unrecorded(prepare(loaded, cache), **options)[1]


def connected(source: str, target: str, more: str = "") -> str:
    """One connection."""
    return f'[[connections]]\nfrom = "{source}"\nto = "{target}"\n{more}\n\n'


def test_a_computed_value_is_that_of_the_same_instant(fmus: Path, tmp_path: Path) -> None:
    """Through another one, a sensor and a map: no step of delay, and the bits of its formula."""
    text = SOURCE + (
        '[computed.sum]\nxy = "source.x + 2 * source.y"\nhalf = "sum.xy / 2"\n'
        'high = "sum.xy > 1 m and not t > 1.5 s"\n\n[sensors.fix]\nbias = "1 m"\n\n'
        + connected("sum.xy", "controller.eta.x", 'sensor = "fix"\ngain = -0.5\noffset = "20 cm"')
    )
    run = ran(text, fmus, tmp_path)
    t = run.points_ns / 1e9
    y = np.array([math.sin(3.0 * s) for s in t.tolist()])
    xy = 2.0 * t + 2.0 * y
    assert np.array_equal(run.signal("sum", "xy"), xy)
    assert np.array_equal(run.signal("sum", "half"), xy / 2.0)
    assert np.array_equal(run.signal("sum", "high"), ((xy > 1.0) & ~(t > 1.5)).astype(float))
    assert np.array_equal(run.signal("controller", "eta.x"), -0.5 * (xy + 1.0) + 0.2)
    units = {i.name: i.component.description.ports for i in run.instances}
    assert units["sum"]["xy"].unit == "m"
    assert units["sum"]["high"].unit is None


@pytest.mark.parametrize("flavour", ["native", "python"])
def test_a_computed_value_has_the_bits_of_a_condition(
    flavour: str, fmus: Path, tmp_path: Path
) -> None:
    """Every function and operator, recorded and carried out on floats, against signals."""
    text = (
        "min(p.a, 2) * max(p.b, p.a, 0.1) - hypot(p.a, p.b) / abs(p.b) + atan2(p.a, p.b)"
        " / 1 rad + sqrt(abs(p.a)) * floor(p.b) - ceil(p.a) + round(7 * p.b) + exp(-abs(p.a))"
        " * log(2 + p.b ** 2) + log(8 + abs(p.a), 2) + tan(p.a) + p.a ** 3 + abs(p.b) ** 1.5"
        " + pi * e"
        " + (asin(sin(p.b)) + acos(cos(p.a)) + atan(p.b)) / 1 rad"
    )
    truth = "p.a < p.b or not p.a >= 0.5 and p.b != p.a or p.a <= -1 or p.a == p.b"
    draws = np.random.default_rng(1).uniform(-3.0, 3.0, (200, 2)).tolist()
    spec = component_module("signal_table.variables").table_spec(
        "Table", [("a", None), ("b", None)], [k * 10**8 for k in range(200)], draws, 0.1
    )
    build_fmu(spec, tmp_path, "native")
    data = {
        "title": "bits",
        "run": {"end": 19.9, "step": 0.1},
        "components": {"p": {"fmu": "Table.fmu"}},
        "computed": {"c": {"y": text, "b": truth}},
        "assertions": [
            {"always": f"c.y == {text}"},
            {"always": f"c.b > 0 and ({truth}) or c.b < 1 and not ({truth})"},
        ],
    }
    loaded = parse(tomli_w.dumps(data), name="bits", where="bits.toml", folder=tmp_path)
    cache = FmuCache(fmus.parent, tmp_path, flavour=flavour)
    outcome, run = execute_unrecorded(prepare(loaded, cache))
    assert [one.result for one in outcome.assertions] == ["holds", "holds"]
    assert len({*run.signal("c", "y").tolist()}) == 200
    assert 0 < run.signal("c", "b").sum() < 200


WRONG_UNIT = connected("plant.eta.y", "controller.nu.u")


@pytest.mark.parametrize(
    ("before", "after", "place"),
    [
        (connected("plant.eta.x", "controller.eta.x", "gain = 2.0"), "", "connections[1]"),
        (
            '[sensors.fix]\nbias = "1 m"\n\n'
            + connected("plant.eta.x", "controller.eta.x", 'sensor = "fix"'),
            "",
            "connections[1]",
        ),
        (SOURCE, connected("source.x", "controller.eta.x"), "connections[0]"),
    ],
    ids=["behind a map", "behind a sensor", "beside a computed value"],
)
def test_an_error_of_a_connection_has_its_place(
    before: str, after: str, place: str, fmus: Path, tmp_path: Path
) -> None:
    """Its own, where others are made into components and more connections."""
    line = (HEAD + before).count("\n") + 1
    with pytest.raises(InputError, match="units of the two ends differ") as refused:
        ran(before + WRONG_UNIT + after, fmus, tmp_path)
    assert str(refused.value).startswith(f"signals.toml:{line}: {place}: ")


def test_an_error_of_a_connection_is_not_that_of_a_like_name(fmus: Path, tmp_path: Path) -> None:
    """`a-plant` ends as `plant` does, whose connection stands behind."""
    text = '[components.a-plant]\nfmu = "AuvPlant"\n\n'
    line = (HEAD + text).count("\n") + 1
    text += WRONG_UNIT.replace("plant", "a-plant") + WRONG_UNIT
    with pytest.raises(InputError, match=r"connection a-plant\.eta\.y") as refused:
        ran(text, fmus, tmp_path)
    assert str(refused.value).startswith(f"signals.toml:{line}: connections[0]: ")


def test_an_error_of_a_mapped_connection_has_its_place(fmus: Path, tmp_path: Path) -> None:
    """The link of a connection with a map is looked at behind the map, and named where it is."""
    text = connected("plant.eta.x", "controller.eta.x")
    text += connected("plant.eta.y", "controller.eta.y", 'gain = 2.0\nlink = "none"')
    with pytest.raises(InputError, match="there is no link 'none'") as refused:
        ran(text, fmus, tmp_path)
    line = (HEAD + text).count("\n") - 1
    assert str(refused.value).startswith(f"signals.toml:{line}: connections[1].link: ")


def noisy(count: int, sigma: float, lane: int) -> Reals:
    """The noise of a sensor `fix` by its definition."""
    draws = [standard_normal(7, "fix", f"noise {lane}", k) for k in range(count)]
    return sigma * np.array(draws)


def test_a_sensor_does_what_its_table_says(fmus: Path, tmp_path: Path) -> None:
    """Sampled, with bias, drift and noise, in steps, in a range, frozen, and set by an event."""
    text = SOURCE + (
        '[sensors.fix]\nsample_time = 0.1\nnoise = { x = "0.5 m" }\nbias = { y = 2.0 }\n'
        'drift = { x = "1 cm/s" }\nresolution = { x = 0.25 }\ngreatest = { x = "3 m" }\n'
        "freeze = { from = 0.5, until = 0.72 }\n\n[[events]]\nat = 1.0\n"
        'set = { "fix.bias.y" = "1 m", "fix.noise.x" = 0.0 }\n\n'
        + connected("source.x", "controller.eta.x", 'sensor = "fix"')
        + connected("source.y", "controller.eta.y", 'sensor = "fix"')
    )
    run = ran(text, fmus, tmp_path)
    t = run.points_ns / 1e9
    taken = np.floor((t + 1e-9) / 0.1).astype(int)
    first = np.array([np.flatnonzero(taken == k)[0] for k in taken])  # point of each sample
    first[(t >= 0.5) & (t < 0.72)] = first[t < 0.5][-1]
    first[(t >= 0.72) & (t < 0.8)] = first[t < 0.5][-1]  # sample 7 was due while it was frozen
    noise = np.where(t < 1.0, noisy(taken.max() + 1, 0.5, 1)[taken], 0.0)
    x = np.minimum(0.25 * np.rint((2.0 * t + 0.0 + 0.01 * t + noise) / 0.25), 3.0)[first]
    y = np.array([math.sin(3.0 * s) for s in t.tolist()]) + np.where(t < 1.0, 2.0, 1.0)
    assert np.array_equal(run.signal("fix", "x"), x)
    assert (run.signal("controller", "eta.y") - y[first]).tolist() == [0.0] * 41
    assert np.array_equal(run.signal("fix", "true.x"), 2.0 * t)
    assert len(set(x[t < 0.5].tolist())) > 3  # it is noisy


EVERYTHING = (Path(__file__).parent / "valid" / "signals-of-every-kind.toml").read_text("utf-8")


def test_engines_and_flavours_give_the_same_bits(fmus: Path) -> None:
    """The kernel in C with native FMUs, the loop in Python with Python's: every value."""
    here = Path(__file__).parent / "valid"
    runs = []
    for engine, flavour in (("kernel", "native"), ("python", "native"), ("python", "python")):
        loaded = parse(EVERYTHING, name="all", where="all.toml", folder=here)
        prepared = prepare(loaded, FmuCache(fmus.parent, here, flavour=flavour))
        runs.append(execute_unrecorded(prepared, engine=engine)[1])
    for other in runs[1:]:
        for one, two in zip(runs[0].instances, other.instances, strict=True):
            assert np.array_equal(one.outputs, two.outputs), one.name
            assert np.array_equal(one.inputs, two.inputs), one.name


@pytest.mark.parametrize(
    ("interpolation", "beyond", "expected"),
    [
        ("linear", "hold", [1.0, 1.0, 2.0, 3.0, 3.0, 3.0]),
        ("hold", "hold", [1.0, 1.0, 1.0, 3.0, 3.0, 3.0]),
        ("linear", "zero", [0.0, 1.0, 2.0, 3.0, 0.0, 0.0]),
        ("linear", "repeat", [2.0, 1.0, 2.0, 3.0, 2.0, 1.0]),
    ],
)
def test_a_series_between_and_beyond_its_rows(
    interpolation: str, beyond: str, expected: list[float], fmus: Path, tmp_path: Path
) -> None:
    """From a CSV file in cm/s2, at points between, on and outside of its rows."""
    (tmp_path / "waves.csv").write_text("time,w,x\n0.25,100,0\n0.75,300,0\n")
    text = (
        '[[inputs]]\nfile = "waves.csv"\ncolumns = { "plant.disturbance.u" = "w" }\n'
        'units = { "plant.disturbance.u" = "cm/s2" }\n'
        f'interpolation = "{interpolation}"\nbeyond = "{beyond}"\n\n'
        '[[assertions]]\nalways = "plant.disturbance.u < 4 m/s2"\n'
    )
    run = ran(text, fmus, tmp_path)
    found = run.signal("plant", "disturbance.u")[[0, 5, 10, 15, 20, 25]]
    assert found.tolist() == pytest.approx(expected, rel=1e-15)


def test_parquet_is_read_as_csv_is(tmp_path: Path) -> None:
    """The same series; and what is wrong with a file has its row."""
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")

    def read(suffix: str) -> Any:
        text = f'[[inputs]]\nfile = "waves.{suffix}"\ncolumns = {{ "plant.disturbance.u" = "w" }}\n'
        return parse(HEAD + text, name="s", where="s.toml", folder=tmp_path).scenario.inputs

    table = {"time": [0.0, 0.1, 0.2], "w": [1.0, 2.5, 1e-3], "word": ["a", "b", "c"]}
    parquet.write_table(arrow.table(table), tmp_path / "waves.parquet")
    (tmp_path / "waves.csv").write_text("time,w\n0,1\n0.1,2.5\n0.2,1e-3\n")
    assert read("parquet") == read("csv")
    for wrong, words in (
        (table | {"w": [1.0, math.nan, 2.0]}, "row 2, column w"),
        (table | {"w": [1.0, None, 2.0]}, "row 2, column w"),
        (table | {"time": [0.0, 0.2, 0.1]}, "row 3, column time"),
        (table | {"w": table["word"]}, "row 1, column w: this is not a number"),
    ):
        parquet.write_table(arrow.table(wrong), tmp_path / "waves.parquet")
        with pytest.raises(InputError, match=words):
            read("parquet")
    (tmp_path / "waves.parquet").write_bytes(b"no parquet")
    with pytest.raises(InputError, match=r"waves\.parquet"):
        read("parquet")


def test_states_of_links_are_numbers(fmus: Path, tmp_path: Path) -> None:
    """Counters, which are integers, and ages; and no part is called as links are in a trace."""
    text = (
        '[computed.seen]\nlate = "up.age > 0.18 s"\n'
        'share = "up.delivered / max(up.sequence + 1, 1)"\n\n'
        + connected("plant.eta", "controller.eta", 'link = "up"')
        + '[links.up]\nkind = "packet"\nsample_time = 0.1\ndelay = 0.15\n'
    )
    run = ran(text, fmus, tmp_path)
    points = np.arange(0, 2001, 50)  # [ms]
    age = points - (points - 150) // 100 * 100
    assert np.array_equal(run.signal("seen", "late")[3:], (age[3:] > 180).astype(float))
    assert run.signal("seen", "share")[-1] == 1.0
    with pytest.raises(InputError, match="the name of links"):
        ran(text.replace("computed.seen", "computed.link"), fmus, tmp_path)


def test_a_constant_is_one_for_the_whole_run(fmus: Path, tmp_path: Path) -> None:
    """A parameter has its value in the scenario; what an event sets is refused."""
    given = 'parameters = { "delay.d" = "250 ms" }\n'
    text = '[computed.c]\ny = "plant.delay.d + 0 * t"\n'
    head = HEAD.replace('fmu = "AuvPlant"\n', f'fmu = "AuvPlant"\n{given}')
    loaded = parse(head + text, name="c", where="c.toml", folder=tmp_path)
    cache = FmuCache(fmus.parent, tmp_path, flavour="native")
    run = execute_unrecorded(prepare(loaded, cache))[1]
    assert set(run.signal("c", "y").tolist()) == {0.25}
    text = '[computed.c]\ny = "plant.disturbance.u"\n\n[[events]]\nat = 1.0\n'
    text += 'set = { "plant.disturbance.u" = 1.0 }\n'
    with pytest.raises(InputError, match="set by an event"):
        ran(text, fmus, tmp_path)


@pytest.mark.parametrize(
    ("more", "as_designed"),
    [
        ("", True),
        ('sensor = "fix"\n\n[sensors.fix]\nsample_time = 10.0\n', False),
        ('\n[computed.seen]\ndepth = "plant.eta.z"\n', True),
    ],
)
def test_what_stands_in_a_loop_is_in_no_design(
    more: str, *, as_designed: bool, fmus: Path, tmp_path: Path
) -> None:
    """A sensor that shows a fix every 10 s: no guarantee of the gain; a value that is only seen."""
    text = 'design = { file = "auv-1.25s" }\n' + HEAD
    text += "".join(connected(f"controller.{x}", f"plant.{x}") for x in ("force", "moment"))
    text += connected("plant.nu", "controller.nu") + connected("plant.eta", "controller.eta", more)
    loaded = parse(text, name="loop", where="loop.toml", folder=tmp_path)
    cache = FmuCache(fmus.parent, tmp_path, flavour="native")
    outcome, _ = execute_unrecorded(prepare(loaded, cache))
    assert outcome.metrics["assumptions"].get("loop_as_designed") is as_designed
    assert outcome.metrics["assumptions"]["certificate_verified"]


def test_a_value_that_does_not_exist_ends_the_run_by_name(fmus: Path, tmp_path: Path) -> None:
    """Division by zero at t = 1 s: the run fails there, and says which value."""
    run = ran('[computed.c]\nbad = "1 s / (t - 1 s)"\n', fmus, tmp_path)
    assert run.status == "failed"
    assert "bad has no finite value at t = 1.0 s: 1 s / (t - 1 s)" in (run.reason or "")
    assert run.points_ns[-1] == 1_000_000_000 or run.count <= 21
