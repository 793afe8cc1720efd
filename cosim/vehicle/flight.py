"""From a vehicle file to a flight whose guarantee is judged: model, design, FMUs, scenario, run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim import hinf, scenario
from cosim.core import (
    PLANT_NOTE,
    AnyPath,
    InputError,
    Progress,
    check_output_folder,
    pyplot,
    silent,
    write_whole,
)
from cosim.fmu import export as exports
from cosim.recordings import write_recordings
from cosim.vehicle.crossing import Crossing, crossing_lines, crossing_title, crossings
from cosim.vehicle.design_model import as_designed_for, flight_model
from cosim.vehicle.flight_design import (
    DESIGN,
    certified_design,
    measurements_of,
    proved_for,
)
from cosim.vehicle.flight_picture import PictureSubject, draw_flight
from cosim.vehicle.flight_plan import FlightSettings, PlannedSensor, recorded_lines
from cosim.vehicle.flight_scenario import RECORDING, Mission, scenario_text
from cosim.vehicle.linearisation import LinearModel
from cosim.vehicle.mission import plan_mission
from cosim.vehicle.read import load_vehicle
from cosim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from cosim.scenario import Outcome

SCENARIO, TRACE, PICTURE = "scenario.toml", "flight.mcap", "flight.png"
"""Files of a flight in its folder."""

_STEPS = 6
_TURNS = 3
_WIDER = 1.25
"""Bound of a state of a wider envelope, for the largest deviation that was flown."""
_CALMER = 0.7
"""Share of the envelope that a calmer flight is to take, and how much calmer it is at least."""


@dataclass(frozen=True)
class Flight:
    """A flight: its outcome, its design, and the folder with all its files.

        >>> from pathlib import Path
        >>> from cosim.vehicle import FlightSettings, fly
        >>> written = Path("diver.toml").write_text('''
        ... name = "diver"
        ... degrees_of_freedom = 4
        ... body = { mass = 100, inertia = [10, 10, 10] }
        ... hydro = { Z_wdot = -10, Z_w = -100 }
        ... thrusters = [{ name = "heave", direction = [0, 0, 1], limit = 50 }]
        ... control = { states = ["eta.z", "nu.w"] }
        ... ''')
        >>> flight = fly("diver.toml", "dive", FlightSettings(link=1.0, duration=10.0))
        >>> flight.design.gamma > flight.design.exact_norm, flight.sensors[0].name
        (True, 'onboard')
        >>> flight.outcome.trace.as_posix()
        'dive/flight.mcap'

    Attributes
    ----------
    crossings : which signals cross which link, and the ages that the proof allows.
    picture : None without matplotlib; then `no_picture` says what to install.
    seconds : wall-clock time of each step [s].
    """

    vehicle: Vehicle
    folder: Path
    outcome: Outcome
    design: hinf.Result
    sensors: tuple[PlannedSensor, ...]
    crossings: tuple[Crossing, ...]
    picture: Path | None
    no_picture: str | None
    seconds: dict[str, float]

    def to_json(self) -> dict[str, Any]:
        """Return everything, for `--json`."""
        return {
            "vehicle": self.vehicle.name,
            "folder": str(self.folder),
            "scenario": str(self.folder / SCENARIO),
            "gamma": self.design.gamma,
            "exact_norm": self.design.exact_norm,
            "measurements": [
                {"name": s.name, "measures": list(s.measures), "greatest_age_s": s.age}
                for s in self.sensors
            ],
            "greatest_command_age_s": self.design.pair.command_age,
            "crossings": [one.to_json() for one in self.crossings],
            "run": self.outcome.to_json(),
            "picture": None if self.picture is None else str(self.picture),
            "seconds": {step: round(s, 2) for step, s in self.seconds.items()},
        }


def fly(  # noqa: PLR0915 - one step after the other
    vehicle: Vehicle | AnyPath,
    folder: AnyPath,
    settings: FlightSettings | None = None,
    *,
    fmu_cache: scenario.FmuCache | None = None,
    say: Callable[[str], None] | None = None,
    progress: Progress | None = None,
) -> Flight:
    """Design for a vehicle that has a slow link, and fly it.

        >>> from pathlib import Path
        >>> from cosim.vehicle import FlightSettings, fly
        >>> written = Path("diver.toml").write_text('''
        ... name = "diver"
        ... degrees_of_freedom = 4
        ... body = { mass = 100, inertia = [10, 10, 10] }
        ... hydro = { Z_wdot = -10, Z_w = -100 }
        ... thrusters = [{ name = "heave", direction = [0, 0, 1], limit = 50 }]
        ... control = { states = ["eta.z", "nu.w"] }
        ... ''')
        >>> flight = fly("diver.toml", "dive", FlightSettings(link=1.0, duration=10.0))
        >>> flight.outcome.status, flight.outcome.metrics["guarantee_claimed"]
        ('finished', True)

    The set-points, and the measurements that the file takes over the link, cross the link; the loop
    is closed on board.

    Parameters
    ----------
    vehicle : a vehicle, the name of one of the gallery, or a `.toml` file.
    folder : for vehicle, design, FMUs, scenario, trace and picture.
    settings : link, losses, duration; None: the defaults.
    fmu_cache : where FMUs of the catalogue are found.
    say : called with a line about each step.

    Raises
    ------
    InputError : the vehicle cannot be designed for, or files cannot be written.
    NotAchievableError : no gain and injections could be certified.
    ComponentError : a component did not start.
    """
    chosen, where = settings or FlightSettings(), Path(folder)
    craft = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    steps = _Steps(say or silent_line, progress or silent)
    check_output_folder(where)
    where.mkdir(parents=True, exist_ok=True)
    with steps("linear model at the trim, uncertainty proved over the envelope"):
        craft = as_designed_for(craft, steps.add)
        write_whole(where / "vehicle.toml", craft.text.encode())
        model, refused = flight_model(craft, chosen)
        if model is None or refused:
            raise refused[0]
        steps.add(_model_line(model))
        for place, taken in craft.defaults.items():
            steps.add(f"not in the file, {place}: {taken}")
    with steps("observer and gain, certified as a pair"):
        model, sensors, design = certified_design(model, chosen, where, steps.add)
        design = _noted(design, model)
        worst = hinf.delay_lti.worst_uncertainty(design.pair.system, design.pair.gain).gain
        steps.add(f"gamma {design.gamma:.4g} certified, exact norm {design.exact_norm or 0:.4g}")
        steps.add(f"largest norm at a constant F that a search found: {worst:.4g}")
        mission = _mission(model, design, chosen)
        across = crossings(sensors, mission.names(model.states), chosen)
        lines = crossing_lines(across, craft.sensors, model.states)
        for line in (*lines, *recorded_lines(sensors, chosen)):
            steps.add(line)
        write_whole(where / DESIGN, design.file_text().encode())
    with steps("plant, sensors and controller as FMUs"):
        names = _write_fmus(model, mission, design, where)
        steps.add(", ".join(names))
    with steps(f"scenario: {where / SCENARIO}"):
        _write_scenario(model, sensors, mission, chosen, where / SCENARIO, steps)
    cache = replace(fmu_cache or scenario.FmuCache(Path("fmus"), where), folder=where)
    with steps(f"flight of {chosen.duration:g} s"):
        for turn in range(1, 1 + _TURNS):
            loaded = scenario.load(str(where / SCENARIO))
            prepared = scenario.prepare(loaded, cache, progress=progress)
            outcome = scenario.execute_run(prepared, where / TRACE, progress=progress)
            used = max((outcome.metrics.get("envelope_use") or {"": 0.0}).values())
            if outcome.status == "failed" or used <= 1.0 or turn == _TURNS:
                break
            steps.add(f"it left its envelope: {100 * used:.0f} %")
            wider = _wider(model, sensors, design, outcome)
            if wider is None:
                steps.add("a calmer flight follows")
                mission = mission.calmer(_CALMER * min(1.0, 1.0 / used))
                _write_scenario(
                    model, sensors, mission, chosen, where / SCENARIO, steps, keep=False
                )
                continue
            model, design = wider
            bounds = ", ".join(f"{name} {b:.3g}" for name, b in model.envelope.items())
            steps.add(f"the same gains are certified for a wider one, gamma {design.gamma:.4g}:")
            steps.add(f"{bounds}; flown again")
            write_whole(where / DESIGN, design.file_text().encode())
            _write_fmus(model, mission, design, where)
    picture, why = None, None
    with steps("picture"):
        try:
            pyplot()
        except InputError as error:
            why = error.hint
        if why is None and outcome.status != "failed":
            subject = _subject(model, design, sensors, mission, across, outcome)
            picture = draw_flight(where / TRACE, subject, where / PICTURE)
    return Flight(craft, where, outcome, design, sensors, across, picture, why, steps.seconds)


def _wider(
    model: LinearModel,
    sensors: Sequence[PlannedSensor],
    design: hinf.Result,
    outcome: Outcome,
) -> tuple[LinearModel, hinf.Result] | None:
    """Return model and design, of the same gains, for an envelope that holds what was flown."""
    bounds = {name: b for name, b in model.envelope.items() if name in model.vehicle.envelope}
    for name, use in outcome.metrics["envelope_use"].items():
        if use > 1.0 and name in bounds:
            bounds[name] *= _WIDER * use
    wider = proved_for(model, design, measurements_of(model, sensors), bounds)
    return None if wider is None else (wider[0], _noted(wider[1], wider[0]))


def _noted(design: hinf.Result, model: LinearModel) -> hinf.Result:
    """Return a design that says how the plant's FMU is seen as its plant."""
    note = {PLANT_NOTE: plant_note(model).to_json()}
    return replace(design, certificate={**design.certificate, **note})


def silent_line(line: str) -> None:
    """Say nothing."""
    del line


class _Steps:
    """Says each step of a flight when it is done, with what it found and how long it took."""

    def __init__(self, say: Callable[[str], None], progress: Progress) -> None:
        self._say, self._progress = say, progress
        self.seconds: dict[str, float] = {}
        self._lines: list[str] = []

    @contextmanager
    def __call__(self, what: str) -> Iterator[None]:
        """Say a step when it is done."""
        began, self._lines = time.perf_counter(), []
        self._progress(what, len(self.seconds) / _STEPS)
        yield
        took = time.perf_counter() - began
        self.seconds[what] = took
        self._say(f"{len(self.seconds)} of {_STEPS}  {what} ({took:.1f} s)")
        for line in self._lines:
            self._say(f"        {line}")

    def add(self, line: str) -> None:
        """Add a line about the present step."""
        self._lines.append(line)


def _model_line(model: LinearModel) -> str:
    n, m = model.system.B.shape
    bounds = ", ".join(f"{name} {bound:g}" for name, bound in model.envelope.items())
    return f"{n} states, {m} controls; about the trim at most: {bounds}"


def plant_note(model: LinearModel) -> scenario.DesignedPlant:
    """Return how the plant's FMU is seen as the linear model."""
    vehicle, actuation = model.vehicle, model.actuation
    trim = dict(model.trim.state)
    limits = {f"actual.{a.name}": a.limit for a in vehicle.actuators}
    inverse = np.asarray(np.linalg.pinv(actuation.thrust_map), dtype=np.float64)
    states = [name for name in model.states if not name.startswith("acting.")]
    acting = len(states) < len(model.states)
    lagged = [a for a in vehicle.actuators if a.lag] if acting else []
    names = (*states, *(f"actual.{a.name}" for a in lagged))
    rows = np.zeros((len(model.states), len(names)))
    for i, name in enumerate(model.states):
        if name in states:  # an actuator counts in share of its limit
            rows[i, states.index(name)] = 1.0 / limits.get(name, 1.0)
            continue
        entry = model.commands.index(name.removeprefix("acting."))
        for actuator in lagged:
            place = names.index(f"actual.{actuator.name}")
            rows[i, place] = inverse[entry, vehicle.actuators.index(actuator)]
    at_trim = tuple(float(value) for value in actuation.at_trim)
    acted = disturbances_of(model)
    return scenario.DesignedPlant(
        state=scenario.LinearSignals(names, tuple(trim[name] for name in names), rows),
        control=scenario.LinearSignals(actuation.actuators, at_trim, inverse),
        disturbance=scenario.LinearSignals(acted, (0.0,) * len(acted)),
        parameters={
            name: value
            for name, value in vehicle.parameters.items()
            if not name.startswith(("initial.", "solver."))
        },
        trim=trim,
        envelope={
            name: (trim.get(name, 0.0), bound * limits.get(name, 1.0))
            for name, bound in model.envelope.items()
            if not name.startswith("acting.")
        },
        neglected=tuple(
            f"other states and the current change {name}' by at most {bound:.3g}, as a disturbance"
            for name, bound in model.disturbance.items()
        ),
        source=vehicle.text,
        model=exports.component_module("vehicle_plant.variables").plant_record(vehicle),
        thrust_map=tuple(map(tuple, actuation.thrust_map.tolist())),
        envelope_share=_share_of_envelope(model),
    )


def _share_of_envelope(model: LinearModel) -> float:
    """Return the least share of a bound in the vehicle's file that the model covers, at most 1."""
    envelope = model.vehicle.envelope
    shares = [b / envelope[name] for name, b in model.envelope.items() if envelope.get(name)]
    return float(f"{min([1.0, *shares]):.6g}")


def disturbances_of(model: LinearModel) -> tuple[str, ...]:
    """Return the inputs of the plant that are the entries of w."""
    rows = np.argmax(np.abs(model.system.C), axis=0)  # a column for each controlled velocity
    return tuple(f"disturbance.{model.states[i].removeprefix('nu.')}" for i in rows)


def _mission(model: LinearModel, design: hinf.Result, settings: FlightSettings) -> Mission:
    return plan_mission(
        design,
        model.states,
        disturbances_of(model),
        model.envelope,
        model.actuation.authority.tolist(),
        settings,
    )


def _write_fmus(
    model: LinearModel, mission: Mission, design: hinf.Result, folder: Path
) -> list[str]:
    """Write the FMUs of a flight; return their names."""
    kind = exports.target_named(exports.DEFAULT_FLAVOUR, "prebuilt")
    data = design.to_json()
    parts = exports.design_parts(data)
    specs = {part: exports.design_part_spec(data, part, name=part) for part in parts}
    if mission.set_points:
        points = [(f"set-point of {model.states[i - 1]}", None) for i in mission.set_points]
        sensor_fmu = exports.component_module("sensor.variables")
        specs["ship"] = sensor_fmu.sensor_spec("ship", points)
    for name, spec in specs.items():
        exports.write_fmu(spec, folder / f"{name}.fmu", kind)
    return [f"{name}.fmu" for name in specs]


def _write_scenario(
    model: LinearModel,
    sensors: Sequence[PlannedSensor],
    mission: Mission,
    settings: FlightSettings,
    path: Path,
    steps: _Steps,
    *,
    keep: bool = True,
) -> None:
    """Write the scenario; one that was there and differs is kept beside it, if `keep`."""
    text = scenario_text(
        model.vehicle.name,
        model.states,
        disturbances_of(model),
        [a.command for a in model.vehicle.actuators],
        {f"initial.{name}": value for name, value in model.trim.state.items() if value},
        sensors,
        mission,
        settings,
    )
    if keep and path.exists() and path.read_text("utf-8") != text:
        kept = path.with_suffix(".before.toml")
        path.replace(kept)
        steps.add(f"the scenario that was there is kept: {kept}")
    write_whole(path, text.encode())
    if settings.recording is not None:
        write_recordings(path.with_name(RECORDING), {"": settings.recording})
    if mission.wave_height:
        sea = f"a sea of {mission.wave_height:g} m and {mission.wave_period:g} s"
        steps.add(f"{sea}, met {mission.wave_depth:g} m down")
    offsets = [f"{model.states[i - 1]} {v:+g}" for i, v in mission.set_points.items()]
    if offsets:
        steps.add(f"set-points over the slow link, back to the trim from {', '.join(offsets)}")
    else:
        steps.add("no set-points: the vehicle holds its trim")


def _subject(
    model: LinearModel,
    design: hinf.Result,
    sensors: Sequence[PlannedSensor],
    mission: Mission,
    across: Sequence[Crossing],
    outcome: Outcome,
) -> PictureSubject:
    aged = ", ".join(f"{s.name} up to {s.age:g} s old" for s in sensors)
    gamma = "" if design.gamma is None else f"γ = {design.gamma:.3g} certified; "
    return PictureSubject(
        title=f"{model.vehicle.name}: {outcome.headline}",
        subtitle=f"{gamma}{aged}; {crossing_title(across)}",
        states=model.states,
        trim=[model.trim.state.get(name, 0.0) for name in model.states],
        positions=list(mission.set_points),
        ages={s.name: s.age for s in sensors},
        limits={a.command: a.limit for a in model.vehicle.actuators},
    )
