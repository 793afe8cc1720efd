"""Faults of event mode, of Clocks and of C++: what a run must show of each, and the run itself.

Two components of eventful.c, of which `h` misbehaves; the output y of both is their time, so that
every row must hold its own. A fault in C++ is what thrower.cpp throws.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from compiled import compile_fmu
from hostile.expected import CRASHES, Expectation
from hostile.hostile_fmu import enumeration
from hostile.judged import departures_of_command
from hostile.runs import CALL_LIMIT_S, MEMORY_LIMIT, Door, Found, line_of, run_command

from cosim.trace import Trace

_SOURCE = Path(__file__).with_name("eventful.c")
CALLS = enumeration(_SOURCE, "calls")
"""Where a fault of an FMU with events may happen."""
FAULTS = enumeration(_SOURCE, "faults")
"""What may happen there; the first one is nothing."""
_IN_EXCHANGE = ("get", "binary", "text")
THROWS = ("load", "instantiate", "step", "get", "free")
"""Where the FMU in C++ may throw."""
AT_S, END_S, STEP_S = 1.0, 2.0, 0.05
_ENDS = ("segfault", "abort", "exit-0", "hang")
_STATUSES = {"error": "fmi3Error", "fatal": "fmi3Fatal"}
JUMP = "jump"
"""`enter-event` by an input that jumps, while values are exchanged at a point."""
_FUNCTIONS = {
    "step": "fmi3DoStep",
    "enter-event": "fmi3EnterEventMode",
    JUMP: "fmi3EnterEventMode",
    "update": "fmi3UpdateDiscreteStates",
    "enter-step": "fmi3EnterStepMode",
    "tick": "fmi3SetClock",
    "interval": "fmi3GetIntervalDecimal",
    "fraction": "fmi3GetIntervalFraction",
    "shift": "fmi3GetShift",
    "get": "fmi3GetFloat64",
    "binary": "fmi3GetBinary",
    "text": "fmi3GetString",
}
"""The function in which a call is."""
AT_START = ("fraction", "shift")
"""Calls at the start alone; all others are made from `AT_S` on."""
_EVERYWHERE = (*_ENDS, *_STATUSES)
_NO_END = "do not come to an end"
_NUMBERS: dict[str, dict[str, str | None]] = {
    "step": {
        "past": r"0\.95 s",
        "negative": "-3 s",
        "now": _NO_END,
        "tiny": _NO_END,
        "ahead": r"1\.5 s",
        "huge-number": r"1e\+300 s",
        "not-a-number": "nan s",
        "infinite": "inf s",
        "end": None,
    },
    "within": {
        "past": r"0\.95 s",
        "negative": "-3 s",
        "ahead": r"1\.5 s",
        "huge-number": r"1e\+300 s",
        "not-a-number": "nan s",
        "infinite": "inf s",
    },
    "update": {
        "past": r"0\.95 s",
        "negative": "-3 s",
        "now": _NO_END,
        "tiny": _NO_END,
        "ahead": None,
        "huge-number": None,
        "not-a-number": "nan s",
        "infinite": "inf s",
        "endless": _NO_END,
        "end": None,
    },
    "interval": {
        "negative": "-3 s",
        "now": _NO_END,
        "tiny": _NO_END,
        "huge-number": None,
        "not-a-number": "nan s",
        "infinite": "inf s",
        "no-qualifier": "77",
    },
    "fraction": {
        "now": "0/3 s",
        "tiny": "1/18446744073709551615 s",
        "no-resolution": "1/0 s",
    },
    "shift": {
        "negative": "-3 s",
        "huge-number": None,
        "not-a-number": "nan s",
        "infinite": "inf s",
        "no-resolution": "1/0 s",
    },
    "binary": {
        "large": "1099511627776 bytes",
        "largest": "18446744073709551615 bytes",
        "no-address": "2 bytes at no address",
        "long": "104857600 bytes",
    },
    "text": {"long": "more than"},
    "log": {"long": None},
    "free": {"after-the-end": None},
}
"""Numbers that a call returns: what the error says of each; None: the run goes on."""


@dataclass(frozen=True)
class Row:
    """A fault in a call of an FMU with events, or with `throw` of one in C++."""

    fault: str
    call: str
    version: str = "3.0 events"

    @property
    def name(self) -> str:
        """As a test is called."""
        return f"{self.fault}-in-{self.call}"


def rows() -> Iterator[Row]:
    """Every fault in every call where it makes sense."""
    for call in _FUNCTIONS:
        for fault in _EVERYWHERE:
            yield Row(fault, call)
    yield from number_rows()
    for call in THROWS:
        yield Row("throw", call, "3.0 C++")


def number_rows() -> Iterator[Row]:
    """Every number that may be wrong, and what else leaves the process alive."""
    for call, faults in _NUMBERS.items():
        for fault in faults:
            yield Row(fault, call)


def expectation(row: Row) -> Expectation:
    """What must be shown.

    ================================== ========== ==============================================
    fault                              exit code  what is printed
    ================================== ========== ==============================================
    the process ends, C++ throws       4          component, call, time in the run, the cause
    a call does not end                4          component, call, time in the run, the limit
    a status beyond warning            4          component, what was done, the status
    a number that cannot be            4          component, call, time in the run, the number
    events without progress of time    4          component, time
    a number that is none, but unused  0          nothing: the run is finished
    asks for the end                   0          stopped, and who asked
    ================================== ========== ==============================================
    """
    fault, call = row.fault, row.call
    if fault == "throw":
        where = {"load": "load", "step": r"fmi3DoStep .*t = 1(\.0*)? s", "free": "FreeInstance"}
        words = (where.get(call, call), "SIGABRT")
        return Expectation((4,), ("failed", "finished") if call == "free" else ("failed",), words)
    if fault == "end":
        return Expectation((0,), ("stopped",), ("'h'", "end"))
    phrase = {**_STATUSES, **_NUMBERS.get(call, {})}.get(fault)
    if phrase is None and fault not in _ENDS:
        return Expectation((0,), ("finished",), whole=True)
    words = ["'h'"]
    if fault in _ENDS:
        words += [_FUNCTIONS[call], CRASHES.get(fault, "limit")]
        words += [] if call in AT_START else [r"t = 1(\.0\d*)? s"]
    else:
        words += [phrase or "", *([] if call in AT_START else [r"t = (1(\.\d*)?|0\.95) s"])]
        words += [_FUNCTIONS[call]] if fault not in _STATUSES and call in _FUNCTIONS else []
    if phrase == _NO_END:
        words = ["component 'h': the events", phrase, r"t = 1(\.\d*)? s"]
    return Expectation((4,), ("failed",), tuple(words))


def run_row(row: Row, folder: Path, *, isolate: bool = False, door: Door = "run") -> Found:
    """Run the scenario with the fault of a row in its own process, and look at what is left.

    `door` : as for `hostile.runs.run_row`.
    """
    home = folder / "run"
    home.mkdir()
    _write_scenario(row, home, isolate=isolate)
    done = run_command(line_of(door), folder)
    return Found(row.fault, row.call, row.version, **done, **_look_at(home / "t.mcap", row))


def departures(found: Found) -> list[str]:
    """What is not as expected of the row, in words; empty if all is."""
    expected = expectation(Row(found.fault, found.call, found.version))
    wrong = [*departures_of_command(found, expected), *found.wrong_rows]
    if not found.finished:
        wrong.append("the trace is not finished")
    elif found.status not in expected.statuses:
        wrong.append(f"status {found.status}, expected {' or '.join(expected.statuses)}")
    return wrong


def _look_at(path: Path, row: Row) -> dict[str, object]:
    """What the trace says: every row of both components holds the values of its time."""
    kept, finished, status, wrong = None, False, None, []
    if path.exists():
        trace = Trace(path)
        finished, status = trace.finished, (trace.result or {}).get("status")
        for topic in [t for t in ("/h/output", "/s/output") if t in trace.topics]:
            columns = trace.read(topic)
            times, y = columns.log_time_ns / 1e9, columns["y"]
            kept = len(y)
            astray = np.flatnonzero(np.abs(times - y) > 1e-8)
            if astray.size:
                k = int(astray[0])
                wrong.append(f"{topic}: the row of t = {times[k]:g} s has values of {y[k]:g} s")
            low, high = _last_row(row)
            if not low <= times[-1] <= high:
                wrong.append(f"{topic}: the rows end at t = {times[-1]:g} s")
    return {
        "rows_kept": kept,
        "rows_run": kept or 0,
        "finished": finished,
        "status": status,
        "wrong_rows": tuple(wrong),
    }


def _last_row(row: Row) -> tuple[float, float]:
    """Between which times the last row is [s]."""
    if expectation(row).whole or row.call == "free":
        return END_S - 1e-9, END_S
    if row.call in (*AT_START, "load", "instantiate"):
        return 0.0, 0.0
    before_its_row = row.call in (*_IN_EXCHANGE, "enter-event", "tick")
    return AT_S - STEP_S * before_its_row - 1e-9, AT_S + 1.5 * STEP_S


def _write_scenario(row: Row, home: Path, *, isolate: bool) -> None:
    limits = "".join(f'{name} = "{CALL_LIMIT_S:g} s"\n' for name in ("call", "start", "end"))
    limits += f'memory = "{MEMORY_LIMIT}"\n'
    components = ""
    if row.fault == "throw":
        thrower_fmu(home, row.call)
        components = f'[components.h]\nfmu = "thrower.fmu"\nisolate = {str(isolate).lower()}\n'
    else:
        eventful_fmu(home)
        given = ", ".join(f"{name} = {value!r}" for name, value in parameters(row).items())
        for name in ("h", "s"):
            components += f'[components.{name}]\nfmu = "eventful.fmu"\n'
            if name == "h":
                components += f"isolate = {str(isolate).lower()}\nparameters = {{ {given} }}\n"
                if row.call != "get":  # else it is read within the step before
                    components += 'intermediate = ["y"]\n'
        components += '[[connections]]\nfrom = "h.y"\nto = "s.u"\n'
        components += (
            f'[[connections]]\nfrom = "s.y"\nto = "h.{"d" if row.call == JUMP else "u"}"\n'
        )
    (home / "s.toml").write_text(
        f'title = "Events"\n[run]\nend = {END_S}\nstep = {STEP_S}\n{components}[limits]\n{limits}'
    )


def parameters(row: Row) -> dict[str, float]:
    """The parameters of a row's FMU."""
    call = CALLS.index("enter-event" if row.call == JUMP else row.call)
    at = 0.0 if row.call in AT_START else AT_S + STEP_S if row.call == JUMP else AT_S
    return {"fault": FAULTS.index(row.fault), "call": call, "at": at}


def eventful_fmu(folder: Path, *flags: str) -> Path:
    """Make eventful.fmu; its parameters say what happens. `flags` : of the compiler."""
    clocks = "".join(
        f'<Clock name="{name}" valueReference="{reference}" causality="input" {more}/>'
        for reference, (name, more) in enumerate(
            (
                ("tick", 'intervalVariability="changing"'),
                ("beat", 'intervalVariability="fixed"'),
                ("third", 'intervalVariability="fixed" supportsFraction="true"'),
            ),
            1,
        )
    )
    outputs = {
        10: '<Float64 name="y" causality="output" intermediateUpdate="true"',
        11: '<Binary name="blob" causality="output"',
        12: '<String name="words" causality="output"',
    }
    inputs = (
        '<Float64 name="u" valueReference="13" causality="input" start="0"/>'
        '<Float64 name="d" valueReference="17" causality="input" variability="discrete" start="0"/>'
    )
    parameters = "".join(
        f'<{kind} name="{name}" valueReference="{reference}" causality="parameter" '
        'variability="fixed" start="0"/>'
        for reference, (name, kind) in enumerate(
            (("fault", "Int32"), ("call", "Int32"), ("at", "Float64")), 14
        )
    )
    variables = "".join(f'{text} valueReference="{n}"/>' for n, text in outputs.items())
    structure = "".join(f'<Output valueReference="{n}" dependencies=""/>' for n in outputs)
    return compile_fmu(
        _SOURCE,
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="3.0" modelName="eventful" instantiationToken="e">'
        '<CoSimulation modelIdentifier="eventful" hasEventMode="true" canGetAndSetFMUState="true" '
        'canHandleVariableCommunicationStepSize="true" providesIntermediateUpdate="true" '
        'mightReturnEarlyFromDoStep="true"/><LogCategories><Category name="logAll"/>'
        '</LogCategories><ModelVariables><Float64 name="time" valueReference="0" '
        f'causality="independent" variability="continuous"/>{clocks}{variables}{inputs}'
        f"{parameters}</ModelVariables><ModelStructure>{structure}</ModelStructure>"
        "</fmiModelDescription>\n",
        folder / "eventful.fmu",
        "-Wno-unused-function",
        *flags,
    )


def thrower_fmu(folder: Path, call: str) -> Path:
    """Make thrower.fmu, which throws in that call; needs a compiler of C++."""
    return compile_fmu(
        _SOURCE.with_name("thrower.cpp"),
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="3.0" modelName="thrower" instantiationToken="t">'
        '<CoSimulation modelIdentifier="thrower" canHandleVariableCommunicationStepSize="true"/>'
        '<ModelVariables><Float64 name="time" valueReference="0" causality="independent" '
        'variability="continuous"/><Float64 name="y" valueReference="1" causality="output"/>'
        '</ModelVariables><ModelStructure><Output valueReference="1" dependencies=""/>'
        "</ModelStructure></fmiModelDescription>\n",
        folder / "thrower.fmu",
        f"-DTHROWS_IN={call.upper()}",
    )
