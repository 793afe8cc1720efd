"""What conditions cost a run: an event, a mode machine, an assertion, the state of a link.

Built-in `auv-acoustic` at steps of 10 ms for 400 s, and two tiny FMUs in C with six signals each
way, where the master is all that counts; nothing is recorded. None of the conditions ever holds.
Least CPU of several turns, the variants taking turns; a ratio is to the run without a condition.

`python -m tests.benchmarks.conditions --json` prints {"conditions": {RUN: {VARIANT: ratio}}}.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from rich.table import Table

from cosim.scenario import (
    FmuCache,
    PreparedScenario,
    Wanted,
    execute_unrecorded,
    load,
    prepare,
)
from tests.benchmarks._show import show
from tests.benchmarks._tiny import tiny_fmu

TURNS = 7
TINY = """\
title = "Two small FMUs"
connect = ["a.x -> b.u : link", "b.x -> a.u : back"]
[run]
end = 100.0
step = 0.001
[components.a]
fmu = "tiny6.fmu"
[components.b]
fmu = "tiny6.fmu"
[links.link]
kind = "packet"
sample_time = "10 ms"
[links.back]
kind = "packet"
sample_time = "10 ms"
"""
RUNS = {
    "auv-acoustic": ("auv-acoustic", "plant.eta.x", "uplink", ("run.end=400", "run.step=0.01")),
    "two small FMUs": ("tiny.toml", "a.x[1]", "link", ()),
}


def variants(signal: str, link: str) -> dict[str, str]:
    """The settings of each variant, by name."""
    return {
        "none": "",
        "when": f'events=[{{when="abs({signal}) > 1e5 and t > 10 s",stop=true}}]',
        "two of them": "events=["
        + ",".join(f'{{when="{signal} {sign}1e5",stop=true}}' for sign in ("> ", "< -"))
        + "]",
        "mode machine": 'modes.m={states=["a","b"],transitions=[{to="b",when="'
        f'{signal} > 1e5"}}]}}',
        "assertion": f'assertions=[{{always="{signal} < 1e5"}}]',
        "state of a link": f'events=[{{when="{link}.age > 1000 s",stop=true}}]',
    }


def measured(scenario: str, signal: str, link: str, settings: tuple[str, ...]) -> dict[str, float]:
    """The least CPU of each variant [s]."""
    prepared: dict[str, PreparedScenario] = {}
    for name, setting in variants(signal, link).items():
        loaded = load(scenario, [*settings, *([setting] if setting else [])])
        prepared[name] = prepare(loaded, FmuCache(Path("fmus"), loaded.folder))
    least = dict.fromkeys(prepared, float("inf"))
    for _ in range(TURNS):
        for name, one in prepared.items():
            began = time.process_time()
            execute_unrecorded(one, zero_state_run=False, wanted=Wanted(["status"]))
            least[name] = min(least[name], time.process_time() - began)
    return least


def main() -> None:
    """Measure, print."""
    with tempfile.TemporaryDirectory() as scratch:
        tiny_fmu(6, Path(scratch))
        (Path(scratch) / "tiny.toml").write_text(TINY)
        found = {
            name: measured(
                str(Path(scratch) / scenario) if scenario.endswith("toml") else scenario, *rest
            )
            for name, (scenario, *rest) in RUNS.items()
        }
    view = Table(title="a run with conditions, times one without", title_justify="left")
    names = [*next(iter(found.values()))]
    for column in ("", "without", *names[1:]):
        view.add_column(column, justify="right" if column else "left")
    ratios = {
        run: {name: seconds / row["none"] for name, seconds in row.items()}
        for run, row in found.items()
    }
    for run, row in ratios.items():
        view.add_row(
            run, f"{1e3 * found[run]['none']:.0f} ms", *(f"{row[n]:.2f}" for n in names[1:])
        )
    show(view, {"conditions": ratios})


if __name__ == "__main__":
    main()
