"""FMI variables of Observer and OutputFeedback, for any pair of a gain and injections.

Their start values are the doubles of a certificate of kind "output-feedback".
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cosim.core import InputError
from cosim.fmu import ComponentSpec, Variable, component_module, solver_step

_PLANT = component_module("delayed_plant.variables")
_SOURCES = (
    *("cosim.models.products", "cosim.models.delayed_linear", "cosim.models.delay_line"),
    *("cosim.models.feedback", "cosim.models.observer", "cosim.fmu.export.python.delay_plant"),
    "cosim.components.observer.behaviour",
)
_STEP = 0.05  # [s], of the default experiment
_NEVER = -1.0  # stamp of an input that has had no packet


def observer_spec(
    name: str,
    certificate: bytes,
    *,
    ages: Mapping[str, float] | None = None,
    envelope: Mapping[int, float] | None = None,
    initial: Sequence[float] = (),
    stop: float = 60.0,
) -> ComponentSpec:
    """Specify the observer of a certificate alone, which is told the control that acts.

    `ages`, `envelope`, `initial` : as for `output_feedback_spec`.
    """
    own = _Part(json.loads(certificate), ages or {}, envelope or {}, initial)
    inputs = [
        Variable(u, "input", "control as it acts: limited, and at the time at which it acts")
        for u in own.controls("u")
    ]
    return own.spec(
        name,
        "Observer of late measurements, with the estimate of a certified pair",
        [*own.measured(), *inputs],
        [*own.results(), *own.watched(("age", "envelope"))],
        [*own.matrices(), *own.settings()],
        {"commands": [], "limited": False, "mapped": False, "trimmed": False},
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
    command_delay: float = 0.0,
    ages: Mapping[str, float] | None = None,
    envelope: Mapping[int, float] | None = None,
    initial: Sequence[float] = (),
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
    limits, safe : one per output; no limits by default, and safe values of zero.
    command_delay : after which a command acts, by play-out at the actuator [s].
    ages : greatest age per measurement [s]; by default what the certificate allows, less the age
        that it allows the command.
    envelope : bound by the number of a state (from 1), where the proof has one.
    initial : estimate for t <= start, length n; zero by default.
    outputs : name and unit of each; u[1], u[2], ... by default.
    allocation : (m, r) the control u that outputs give, where they are not u themselves.
    thrust_map : (r, m) outputs for a control u; by default the pseudo-inverse of `allocation`.
    trim, trim_measured : outputs and measured values at the trim, of which the system describes
        the deviations.

    Raises
    ------
    InputError : sizes that do not fit, or an allocation that does not give every control.
    """
    own = _Part(json.loads(certificate), ages or {}, envelope or {}, initial)
    m = len(own.B[0])
    named = list(outputs) or [(u, None) for u in own.controls("u")]
    names, r = [one for one, _ in named], len(named)
    maps = _maps(allocation, thrust_map, m, r)
    for word, values in (("limits", limits), ("safe", safe), ("trim", trim)):
        if len(values) not in (0, r):
            raise InputError(
                f"the {word} do not fit the outputs", expected=str(r), got=str(len(values))
            )
    trimmed = bool(trim) or trim_measured is not None
    K = own.data["K"]
    references = [
        Variable(f"reference[{i}]", "input", f"set point of state {i}") for i in own.numbers
    ]
    commands = [
        Variable(one, "output", f"command {one}, held between samples", unit, discrete=True)
        for one, unit in named
    ]
    applied = [
        Variable(u, "output", f"control that the observer takes to act, {u}", discrete=True)
        for u in own.controls("applied")
    ]
    text = "1: a measurement is too old, and the safe values are commanded; 0: they are not"
    watchdog = Variable("watchdog", "output", text, kind="Integer")
    units = dict(named)
    feedback = [*_entries("K", K, "gain of control {i} on state {j}, u = K xh")]
    for letter, matrix in maps.items():
        feedback += _entries(letter, matrix, f"entry ({{i}},{{j}}) of the {_MAPS[letter]}")
    feedback += [
        Variable(f"limit.{one}", "parameter", f"largest {one}", units[one], value, minimum=0.0)
        for one, value in zip(names if limits else (), limits, strict=True)
    ]
    feedback += [
        Variable(f"safe.{one}", "parameter", f"safe value of {one}", units[one], value)
        for one, value in zip(names, safe or [0.0] * r, strict=True)
    ]
    if trimmed:
        offsets = dict(zip(names, trim or [0.0] * r, strict=True))
        for one, values in own.of_measurements(trim_measured or {}).items():
            offsets |= {f"{one}[{i}]": value for i, value in enumerate(values, 1)}
        feedback += [
            Variable(f"trim.{one}", "parameter", f"{one} at the trim", units.get(one), value)
            for one, value in offsets.items()
        ]
    period = "sampling period of the commands; 0: at every communication point"
    feedback += [
        Variable("sample_time", "parameter", period, "s", sample_time, minimum=0.0),
        Variable(
            *("command.delay", "parameter", "time after which a command acts at the actuator"),
            *("s", command_delay),
            minimum=0.0,
        ),
    ]
    return own.spec(
        name,
        "Observer of late measurements and sampled feedback of its estimate, as certified",
        [*own.measured(), *references],
        [*commands, *applied, *own.results(), watchdog]
        + own.watched(("age", "envelope", "saturation")),
        [*own.matrices(), *feedback, *own.settings()],
        {
            "commands": names,
            "limited": bool(limits),
            "mapped": bool(maps),
            "trimmed": trimmed,
        },
        certificate,
        stop,
    )


_MAPS = {
    "thrust_map": "map from controls to commands",
    "allocation": "map from commands to controls",
}


def _maps(
    allocation: Sequence[Sequence[float]], thrust_map: Sequence[Sequence[float]], m: int, r: int
) -> dict[str, list[list[float]]]:
    """Return both maps, each the pseudo-inverse of the other where one is given; none of none."""
    if not len(allocation) and not len(thrust_map):
        if m != r:
            raise InputError(
                "the outputs need an allocation", expected=f"{m} outputs", got=f"{r} outputs"
            )
        return {}
    # imported for maps alone: what is packed without one is described without it
    import numpy as np  # noqa: PLC0415

    given = {"thrust_map": (thrust_map, (r, m)), "allocation": (allocation, (m, r))}
    found = {}
    for name, (matrix, shape) in given.items():
        if len(matrix):
            found[name] = np.array(matrix, dtype=float)
            if found[name].shape != shape:
                raise InputError(f"the {name} does not fit", expected=f"{shape}", got=str(found[name].shape))
    for name, other in (("thrust_map", "allocation"), ("allocation", "thrust_map")):
        if name not in found:
            found[name] = np.linalg.pinv(found[other])
    off = np.abs(found["allocation"] @ found["thrust_map"] - np.eye(m)).max()
    if not off < 1e-6:  # noqa: PLR2004 - rounding of maps with six digits
        raise InputError(
            "the outputs do not give the control that is commanded",
            expected="allocation @ thrust_map = I",
            got=f"off by {off:.3g}",
            hint="an actuator for each controlled direction",
        )
    return {name: found[name].tolist() for name in given}


def _entries(letter: str, matrix: Sequence[Sequence[float]], text: str) -> Iterator[Variable]:
    for i, row in enumerate(matrix, 1):
        for j, value in enumerate(row, 1):
            yield Variable(f"{letter}[{i},{j}]", "parameter", text.format(i=i, j=j), None, value)


class _Part:
    """What both FMUs of a certificate have."""

    def __init__(
        self,
        data: Any,
        ages: Mapping[str, float],
        envelope: Mapping[int, float],
        initial: Sequence[float],
    ) -> None:
        if data.get("kind") != "output-feedback":
            raise InputError(
                "this certificate is about no observer",
                expected='kind "output-feedback"',
                got=repr(data.get("kind")),
            )
        self.data, self.envelope = data, envelope
        plant = data["plant"]
        self.A, self.B = plant["A"], plant["B"]
        # a delay through which only the control acts is the link's
        self.late = [d for d in plant["delays"] if any(any(row) for row in d["A"])]
        self.delays = _PLANT.delay_names(len(self.late))
        self.numbers = range(1, len(self.A) + 1)
        self.measurements = {one["name"]: one for one in data["measurements"]}
        usual = {name: float(one["d"]) for name, one in self.measurements.items()}
        unknown = {*ages} - {*usual}
        if unknown or not all(value > 0 for value in {**usual, **ages}.values()):
            raise InputError(
                "the greatest ages do not fit the measurements",
                expected=f"seconds > 0 for {', '.join(usual)}",
                got=str({**usual, **ages}),
            )
        self.ages = {**usual, **ages}
        self.initial = list(initial) or [0.0] * len(self.A)

    def controls(self, word: str) -> list[str]:
        """Return the names of all controls."""
        return [f"{word}[{j}]" for j in range(1, len(self.B[0]) + 1)]

    def of_measurements(self, values: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
        """Return a value for each row of each measurement, zero where none is given."""
        return {
            name: list(values.get(name, [0.0] * len(one["C"])))
            for name, one in self.measurements.items()
        }

    def measured(self) -> list[Variable]:
        """Return the inputs of all measurements."""
        table = []
        for name, one in self.measurements.items():
            table += [
                Variable(f"{name}[{i}]", "input", f"measurement {name}, value {i}", discrete=True)
                for i in range(1, len(one["C"]) + 1)
            ]
            text = f"time at which {name} was measured; {name} is used when this is later"
            table.append(Variable(f"stamp.{name}", "input", text, "s", _NEVER, discrete=True))
        return table

    def results(self) -> list[Variable]:
        """Return estimate, innovations, and ages."""
        table = [
            Variable(f"estimate[{i}]", "output", f"estimate of state {i}", start=value)
            for i, value in enumerate(self.initial, 1)
        ]
        for name, one in self.measurements.items():
            table += [
                Variable(
                    f"innovation.{name}[{i}]",
                    "output",
                    f"{name}[{i}] against the estimate of its time, in use since it arrived",
                    discrete=True,
                )
                for i in range(1, len(one["C"]) + 1)
            ]
        for name in self.measurements:
            text = f"time since {name} in use was measured, or since the start"
            table.append(Variable(f"message_age.{name}", "output", text, "s"))
            text = f"packets of {name} not used: older than the one in use, or than age.{name}"
            table.append(Variable(f"ignored.{name}", "output", text, kind="Integer"))
        return table

    def watched(self, uses: Sequence[str]) -> list[Variable]:
        """Return the use of assumptions, present and greatest."""
        table = []
        for word, when in (("present", "at present"), ("assumption", "greatest so far")):
            table += [
                Variable(f"{word}.{use}", "output", f"use of the {_USES[use]}, {when}; 1 is all of it")
                for use in uses
            ]
        text = "1 while no assumption has been used beyond what is allowed, 0 from then on"
        table.append(Variable("assumption.met", "output", text, None, 1.0, "Integer"))
        return table

    def matrices(self) -> list[Variable]:
        """Return plant, measurements and injections."""
        entry = "entry ({i},{j}) of "
        found = [*_entries("A", self.A, f"{entry}A")]
        for k, delay in enumerate(self.late, 1):
            found += _entries(f"A{k}", delay["A"], f"{entry}A{k}")
        found += _entries("B", self.B, f"{entry}B")
        for (name, one), L in zip(self.measurements.items(), self.data["L"], strict=True):
            found += _entries(f"C.{name}", one["C"], f"value {{i}} of {name} per state {{j}}")
            found += _entries(f"L.{name}", L, f"injection into state {{i}} per innovation {{j}} of {name}")
        return found

    def settings(self) -> list[Variable]:
        """Return delays, ages, envelope, initial estimate and solver step."""
        found = [
            Variable(one, "parameter", f"delay {one[6:]} of the plant", "s", delay["d"], minimum=0.0)
            for one, delay in zip(self.delays, self.late, strict=True)
        ]
        found += [
            Variable(
                f"age.{name}", "parameter", f"greatest age of {name} allowed", "s", d, minimum=0.0
            )
            for name, d in self.ages.items()
        ]
        found += [
            Variable(
                f"envelope[{i}]", "parameter", f"largest estimate {i} allowed", None, bound, minimum=0.0
            )
            for i, bound in sorted(self.envelope.items())
        ]
        found += [
            Variable(f"initial.estimate[{i}]", "parameter", f"estimate {i} for t <= start", None, x)
            for i, x in zip(self.numbers, self.initial, strict=True)
        ]
        import numpy as np  # noqa: PLC0415 - as in `_maps`

        rates = {"A": np.array(self.A)}
        rates |= {f"A{k}": np.array(d["A"]) for k, d in enumerate(self.late, 1)}
        for name, L in zip(self.measurements, self.data["L"], strict=True):
            rates[f"A.{name}"] = np.array(L)
        return [*found, solver_step(_PLANT.default_step(rates))]

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
    ) -> ComponentSpec:
        """Return the specification."""
        sizes = [[one, len(given["C"])] for one, given in self.measurements.items()]
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
                "measurements": sizes,
                "delays": self.delays,
                "envelope": sorted(self.envelope),
                **constants,
            },
            certificate=certificate,
            slave="cosim.fmu.export.python.watched_slave:WatchedSlave",
        )


_USES = {"age": "greatest ages", "envelope": "envelope", "saturation": "limits of the commands"}


def design_parameters(data: Any) -> dict[str, float]:
    """Return the parameters that a certificate of kind "output-feedback" decides, by name.

    They are the matrices of the plant and of its measurements, K, L, and the delays.
    """
    own = _Part(data, {}, {}, ())
    table = [*own.matrices(), *_entries("K", data["K"], "")]
    delays = zip(own.delays, own.late, strict=True)
    return {v.name: v.start for v in table} | {name: float(d["d"]) for name, d in delays}
