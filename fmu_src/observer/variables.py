"""FMI variables of Observer and OutputFeedback, for any pair of a gain and injections.

Their start values are the doubles of a certificate of kind "output-feedback".
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import InputError
from cosim.fmu.export import ComponentSpec, Variable, component_module, solver_step

from .allocation import maps_between
from .page import notes, scenario_of

watched_variables = component_module("hinf_controller.variables").watched_variables

_PLANT = component_module("delayed_plant.variables")
_SOURCES = (
    *("cosim.models.products", "cosim.models.delayed_linear", "cosim.models.delay_line"),
    *("cosim.models.feedback", "cosim.models.observer", "cosim.models.assumptions"),
    *("cosim.fmu.export.python.delay_plant", "cosim.components.observer.behaviour"),
)
_STEP = 0.05  # [s], of the default experiment
_NEVER = -1.0  # stamp of an input that has had no packet
_MAPS = {
    "thrust_map": "entry ({i},{j}) of the map from controls to commands",
    "allocation": "entry ({i},{j}) of the map from commands to controls",
}


def observer_spec(
    name: str,
    certificate: bytes,
    *,
    ages: Mapping[str, float] | None = None,
    envelope: Mapping[int, float] | None = None,
    initial: Sequence[float] = (),
    units: Sequence[str | None] = (),
    trim_measured: Mapping[str, Sequence[float]] | None = None,
    stop: float = 60.0,
) -> ComponentSpec:
    """Specify the observer of a certificate alone, which is told the control that acts.

    Parameters are those of `output_feedback_spec`.
    """
    own = _Pair(json.loads(certificate), ages, envelope, initial, units)
    text = "control that acts: limited, and at the time at which it does"
    trims = [] if trim_measured is None else own.trims(trim_measured)
    return own.spec(
        name,
        "Observer of late measurements, of a certified pair",
        [*own.measured(), *(Variable(u, "input", text) for u in own.controls("u"))],
        [*own.results(), *watched_variables(("age", "envelope"))],
        [*own.matrices(), *trims, *own.settings()],
        {"commands": [], "with_limits": False, "mapped": False, "trimmed": bool(trims)},
        certificate,
        stop,
    )


def output_feedback_spec(
    name: str,
    certificate: bytes,
    *,
    sample_time: float = 0.0,
    limits: Sequence[float] = (),
    safe: Sequence[float] = (),
    command_delay: float | None = None,
    ages: Mapping[str, float] | None = None,
    envelope: Mapping[int, float] | None = None,
    initial: Sequence[float] = (),
    units: Sequence[str | None] = (),
    outputs: Sequence[tuple[str, str | None]] = (),
    allocation: Sequence[Sequence[float]] = (),
    thrust_map: Sequence[Sequence[float]] = (),
    trim: Sequence[float] = (),
    trim_measured: Mapping[str, Sequence[float]] | None = None,
    stop: float = 60.0,
) -> ComponentSpec:
    """Specify observer and gain of a certificate of kind "output-feedback".

    Parameters
    ----------
    sample_time : of the commands [s]; 0: at every communication point.
    limits, safe : one per output; by default no limits, and safe values of zero, or of `trim`.
    command_delay : after which a command acts, by play-out at the actuator [s]; by default the
        age of the command where the certificate is about just this one, else 0.
    ages : greatest age per measurement [s]; by default, and at most, that of the certificate.
    envelope : bound by the number of a state (from 1), where the proof has one.
    initial : estimate for t <= start, length n; zero by default.
    units : of the states.
    outputs : name and unit of each; u[1], u[2], ... by default.
    allocation : (m, r) the control u that outputs give, where they are not u themselves.
    thrust_map : (r, m) outputs for a control u; by default the pseudo-inverse of `allocation`.
    trim, trim_measured : outputs and measured values at the trim, of which the system describes
        the deviations.

    Raises
    ------
    InputError : another certificate, sizes that do not fit, or maps that are no inverse of each
        other.
    """
    own = _Pair(json.loads(certificate), ages, envelope, initial, units)
    named = list(outputs) or [(u, None) for u in own.controls("u")]
    names, unit_of = [one for one, _ in named], dict(named)
    maps = maps_between(thrust_map, allocation, len(own.B[0]), len(named))
    for word, values in (("limits", limits), ("safe", safe), ("trim", trim)):
        own.fits(word, values, len(named), "one per output")
    starts = dict(zip(names, trim, strict=False))
    beyond = {x: lim for x, lim in zip(names, limits, strict=False) if abs(starts.get(x, 0)) > lim}
    if beyond:
        raise InputError(
            "a trim is beyond the limit of its command",
            expected=", ".join(f"{x}: at most {limit:g}" for x, limit in beyond.items()),
            got=", ".join(f"{starts[x]:g}" for x in beyond),
        )
    references = [
        Variable(f"reference[{i}]", "input", f"set point of state {i}", own.units[i - 1])
        for i in own.numbers
    ]
    results = [
        *(
            Variable(
                *(one, "output", f"command {one}, held between samples", unit),
                starts.get(one, 0.0),
                discrete=True,
            )
            for one, unit in named
        ),
        *(
            Variable(u, "output", "control that acts, as the observer knows it", discrete=True)
            for u in own.controls("applied")
        ),
        *own.results(),
        Variable(
            *("watchdog", "output", "1 while a measurement is too old, and safe values are in use"),
            kind="Integer",
        ),
        *watched_variables(("age", "envelope", "saturation")),
    ]
    parameters = [
        *own.matrices(),
        *_entries("K", own.data["K"], "gain of control {i} on state {j}, u = K (xh - reference)"),
        *(v for letter, matrix in maps.items() for v in _entries(letter, matrix, _MAPS[letter])),
    ]
    trims: dict[str, float] = {}
    if len(trim) or trim_measured is not None:
        trims = dict(zip(names, trim or [0.0] * len(named), strict=True))
    for word, text, starts in (
        ("limit", "largest", dict(zip(names, limits, strict=False))),
        (
            "safe",
            "safe value of",
            dict(zip(names, safe or trim or [0.0] * len(named), strict=True)),
        ),
        ("trim", "value at the trim of", trims),
    ):
        least = 0.0 if word == "limit" else None
        parameters += [
            Variable(f"{word}.{x}", "parameter", f"{text} {x}", unit_of[x], value, minimum=least)
            for x, value in starts.items()
        ]
    if trims:
        parameters += own.trims(trim_measured or {})
    return own.spec(
        name,
        "Observer of late measurements and feedback of its estimate, as certified",
        [*own.measured(), *references],
        results,
        [*parameters, *own.command(sample_time, command_delay), *own.settings()],
        {
            "commands": names,
            "with_limits": len(limits) > 0,
            "mapped": len(maps) > 0,
            "trimmed": len(trims) > 0,
        },
        certificate,
        stop,
        "" if outputs or maps or trims else scenario_of(own.data, f"{name}.fmu"),
    )


def _entries(letter: str, matrix: Sequence[Sequence[float]], text: str) -> Iterator[Variable]:
    for i, row in enumerate(matrix, 1):
        for j, value in enumerate(row, 1):
            yield Variable(f"{letter}[{i},{j}]", "parameter", text.format(i=i, j=j), None, value)


def _seconds(name: str, text: str, value: float) -> Variable:
    return Variable(name, "parameter", text, "s", value, minimum=0.0)


class _Pair:
    """What both FMUs of a certificate have, list by list."""

    def __init__(
        self,
        data: Any,
        ages: Mapping[str, float] | None,
        envelope: Mapping[int, float] | None,
        initial: Sequence[float],
        units: Sequence[str | None],
    ) -> None:
        if data.get("kind") != "output-feedback":
            raise InputError(
                "this certificate is about no observer",
                expected='kind "output-feedback"',
                got=repr(data.get("kind")),
            )
        self.data, plant = data, data["plant"]
        self.A, self.B = plant["A"], plant["B"]
        n = len(self.A)
        # a delay through which only the control acts is the link's
        self.late = [d for d in plant["delays"] if any(any(row) for row in d["A"])]
        self.delays = _PLANT.delay_names(len(self.late))
        self.numbers = range(1, n + 1)
        self.measurements = {one["name"]: one for one in data["measurements"]}
        for one in self.measurements:
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", one):
                raise InputError(
                    "a measurement has no name of a variable",
                    expected="ASCII letters, digits, _; a letter first",
                    got=repr(one),
                )
        self.ages = self._ages(ages or {})
        self.envelope = dict(sorted((envelope or {}).items()))
        if not all(i in self.numbers and bound > 0 for i, bound in self.envelope.items()):
            raise InputError(
                "the envelope does not fit the states",
                expected=f"bounds > 0 of states 1 to {n}",
                got=str(self.envelope),
            )
        for word, values in (("initial estimate", initial), ("units", units)):
            self.fits(word, values, n, "one per state")
        self.initial = list(initial) or [0.0] * n
        self.units = list(units) or [None] * n

    def _ages(self, chosen: Mapping[str, float]) -> dict[str, float]:
        proved = {name: float(one["d"]) for name, one in self.measurements.items()}
        found = {**proved, **chosen}
        fits = all(d > 0 and (d <= proved.get(x, d) or not proved[x]) for x, d in found.items())
        if found.keys() != proved.keys() or not fits:
            raise InputError(
                "the greatest ages are not those of the certificate",
                expected="; ".join(f"{one}: > 0, at most {d:g} s" for one, d in proved.items()),
                got="; ".join(f"{one}: {d:g} s" for one, d in found.items()),
                hint="where the certificate has 0, at once, say what the exchange adds",
            )
        return found

    @staticmethod
    def fits(word: str, values: Sequence[Any], count: int, which: str) -> None:
        """Refuse a list that is neither empty nor of a length (InputError)."""
        if len(values) not in (0, count):
            raise InputError(
                f"the {word} do not fit", expected=f"{count}, {which}", got=str(len(values))
            )

    def controls(self, word: str) -> list[str]:
        """Return a name for each control."""
        return [f"{word}[{j}]" for j in range(1, len(self.B[0]) + 1)]

    def _values(self) -> Iterator[tuple[str, str | None]]:
        """Yield each measured value and its unit, that of a state if it is one."""
        for name, one in self.measurements.items():
            for i, row in enumerate(one["C"], 1):
                used = [j for j, entry in enumerate(row) if entry]
                alone = len(used) == 1 and row[used[0]] == 1
                yield f"{name}[{i}]", self.units[used[0]] if alone else None

    def measured(self) -> list[Variable]:
        """Return the inputs of all measurements."""
        table = [
            Variable(value, "input", f"measured {value}", unit, discrete=True)
            for value, unit in self._values()
        ]
        text = "time at which {0} was measured; {0} is used when this is later than before"
        return table + [
            Variable(f"stamp.{name}", "input", text.format(name), "s", _NEVER, discrete=True)
            for name in self.measurements
        ]

    def results(self) -> list[Variable]:
        """Return estimate, innovations, and ages."""
        table = [
            Variable(f"estimate[{i}]", "output", f"estimate of state {i}", unit, value)
            for i, unit, value in zip(self.numbers, self.units, self.initial, strict=True)
        ]
        text = "{0} against the estimate of its time; held until the next one"
        table += [
            Variable(f"innovation.{value}", "output", text.format(value), unit, discrete=True)
            for value, unit in self._values()
        ]
        for name in self.measurements:
            text = f"time since {name} in use was measured, or since the start"
            table.append(Variable(f"message_age.{name}", "output", text, "s"))
            text = f"packets of {name} not used: older than the one in use, or than age.{name}"
            table.append(Variable(f"ignored.{name}", "output", text, kind="Integer"))
        return table

    def matrices(self) -> list[Variable]:
        """Return plant, measurements and injections."""
        found = [*_entries("A", self.A, "entry ({i},{j}) of A")]
        for k, delay in enumerate(self.late, 1):
            found += _entries(f"A{k}", delay["A"], f"entry ({{i}},{{j}}) of A{k}")
        found += _entries("B", self.B, "entry ({i},{j}) of B")
        for (name, one), L in zip(self.measurements.items(), self.data["L"], strict=True):
            found += _entries(f"C.{name}", one["C"], f"{name}[{{i}}] per state {{j}}")
            found += _entries(f"L.{name}", L, f"x[{{i}}]' per innovation.{name}[{{j}}]")
        return found

    def trims(self, given: Mapping[str, Sequence[float]]) -> list[Variable]:
        """Return the measured values at the trim."""
        starts: dict[str, float] = {}
        for name, one in self.measurements.items():
            values = given.get(name, ())
            self.fits(f"values of {name} at the trim", values, len(one["C"]), "one per value")
            starts |= {f"{name}[{i}]": value for i, value in enumerate(values, 1)}
        return [
            Variable(
                f"trim.{x}", "parameter", f"value at the trim of {x}", unit, starts.get(x, 0.0)
            )
            for x, unit in self._values()
        ]

    def command(self, sample_time: float, delay: float | None) -> list[Variable]:
        """Return sampling and play-out of the commands, and their greatest age."""
        age = float(self.data.get("command_age", 0.0))
        exactly = 0.0 if self.data.get("command_any_age", False) else age
        later = exactly if delay is None else delay
        return [
            _seconds(
                "sample_time", "period of commands; 0: every communication point", sample_time
            ),
            _seconds("command.delay", "time after which a command acts at the actuator", later),
            _seconds("age.command", "greatest age of the estimate behind it; 0: not watched", age),
        ]

    def settings(self) -> list[Variable]:
        """Return delays, ages, envelope, initial estimate and solver step."""
        found = [
            _seconds(one, f"delay {one[6:]} of the plant", delay["d"])
            for one, delay in zip(self.delays, self.late, strict=True)
        ]
        found += [
            _seconds(f"age.{name}", f"greatest age of {name}", d) for name, d in self.ages.items()
        ]
        initial = dict(zip(self.numbers, self.initial, strict=True))
        for word, text, values in (
            ("envelope", "largest |estimate[{0}]|", self.envelope),
            ("initial.estimate", "estimate {0} for t <= start", initial),
        ):
            least = 0.0 if word == "envelope" else None
            found += [
                Variable(
                    *(f"{word}[{i}]", "parameter", text.format(i), self.units[i - 1], value),
                    minimum=least,
                )
                for i, value in values.items()
            ]
        rates = {f"A{k}": np.array(d["A"]) for k, d in enumerate(self.late, 1)}
        return [*found, solver_step(_PLANT.default_step({"A": np.array(self.A), **rates}))]

    def spec(
        self,
        name: str,
        description: str,
        inputs: Sequence[Variable],
        outputs: Sequence[Variable],
        parameters: Sequence[Variable],
        constants: dict[str, Any],
        certificate: bytes,
        stop: float,
        scenario: str = "",
    ) -> ComponentSpec:
        """Return the specification."""
        return ComponentSpec(
            name=name,
            description=description,
            variables=(*inputs, *outputs, *parameters),
            behaviour="cosim.components.observer.behaviour:Observer",
            sources=_SOURCES,
            readme=Path(__file__).with_name("readme.md"),
            stop_time=stop,
            step_size=_STEP,
            constants={
                "size": [len(self.A), len(self.B[0])],
                "measurements": [[one, len(x["C"])] for one, x in self.measurements.items()],
                "delays": self.delays,
                "envelope": [*self.envelope],
                **constants,
            },
            certificate=certificate,
            scenario=scenario,
            notes=notes(self.data, self.ages, constants),
            slave="cosim.fmu.export.python.watched_slave:WatchedSlave",
        )
