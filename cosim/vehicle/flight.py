"""From a vehicle file to a flight whose guarantee is judged: model, design, FMUs, scenario, run."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim import fmu as fmus, hinf, scenario
from cosim.core import DESIGN_FILE, PLANT_NOTE, InputError, NotAchievableError, Progress, silent
from cosim.models import DelaySystem, Measurement
from cosim.trace import pyplot
from cosim.vehicle.flight_picture import PictureSubject, draw_flight
from cosim.vehicle.flight_plan import FlightSettings, PlannedSensor, planned_sensors, sensor_line
from cosim.vehicle.flight_scenario import Mission, scenario_text
from cosim.vehicle.linearisation import LinearModel, linear_model
from cosim.vehicle.mission import plan_mission
from cosim.vehicle.read import load_vehicle
from cosim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from cosim.scenario import Outcome

SCENARIO, TRACE, PICTURE, DESIGN = "scenario.toml", "flight.mcap", "flight.png", "design.json"
"""Files of a flight in its folder."""

_STEPS = 6
_ENVELOPES = (1.0, 0.5, 0.25)
"""Shares of the envelope for which a design is tried in turn."""


@dataclass(frozen=True)
class Flight:
    """A flight: its outcome, what was designed for it, and the folder with everything made for it.

    Attributes
    ----------
    picture : None without matplotlib; then `no_picture` says what to install.
    seconds : wall-clock time of each step [s].
    """

    vehicle: Vehicle
    folder: Path
    outcome: Outcome
    design: hinf.OutputFeedback
    sensors: tuple[PlannedSensor, ...]
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
            "run": self.outcome.to_json(),
            "picture": None if self.picture is None else str(self.picture),
            "seconds": {step: round(s, 2) for step, s in self.seconds.items()},
        }


def fly(
    vehicle: Vehicle | str | Path,
    folder: Path | str,
    settings: FlightSettings | None = None,
    *,
    fmu_cache: scenario.FmuCache | None = None,
    say: Callable[[str], None] | None = None,
    progress: Progress | None = None,
) -> Flight:
    """Design for a vehicle whose fixes and set-points come over a slow link, and fly it.

    Parameters
    ----------
    vehicle : or the name of one of the gallery, or a `.toml` file.
    folder : for vehicle, design, FMUs, scenario, trace and picture.
    settings : link, losses, duration; the defaults without it.
    fmu_cache : where FMUs of the catalogue are.
    say : is called with a line about each step.

    Raises
    ------
    InputError : the vehicle cannot be designed for, or files cannot be written.
    NotAchievableError : no gain and injections could be certified.
    ComponentError : a component did not start.
    """
    chosen, where = settings or FlightSettings(), Path(folder)
    craft = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    steps = _Steps(say or silent_line, progress or silent)
    scenario.check_writable(where / TRACE)
    where.mkdir(parents=True, exist_ok=True)
    (where / "vehicle.toml").write_text(craft.text, "utf-8")
    with steps("linear model at the trim, uncertainty proved over the envelope"):
        model = linear_model(craft)
        steps.add(_model_line(model))
        if craft.default_bounds:
            bounds = ", ".join(f"{n} {craft.envelope[n]:g}" for n in craft.default_bounds)
            steps.add(f"bounds that the file does not give: {bounds}")
    with steps("observer and gain, certified as a pair"):
        model, sensors, design = _designed(model, chosen, where, steps)
        steps.add(f"gamma {design.gamma:.4g} certified, exact norm {design.exact_norm or 0:.4g}")
        mission = _mission(model, design, chosen)
        _save(design, where / DESIGN)
    with steps("plant, sensors and controller as FMUs"):
        names = _write_fmus(model, mission, design, where)
        steps.add(", ".join(names))
    with steps(f"scenario: {where / SCENARIO}"):
        _write_scenario(model, sensors, mission, chosen, where / SCENARIO, steps)
    with steps(f"flight of {chosen.duration:g} s"):
        loaded = scenario.load(str(where / SCENARIO))
        cache = fmu_cache or scenario.FmuCache(Path("fmus"), where)
        prepared = scenario.prepare(loaded, replace(cache, folder=where), progress=progress)
        outcome = scenario.execute_run(prepared, where / TRACE, progress=progress)
    picture, why = None, None
    with steps("picture"):
        try:
            pyplot()
        except InputError as error:
            why = error.hint
        if why is None and outcome.status != "failed":
            subject = _subject(model, design, sensors, mission, outcome)
            picture = draw_flight(where / TRACE, subject, where / PICTURE)
    return Flight(craft, where, outcome, design, sensors, picture, why, steps.seconds)


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


def measurements_of(
    model: LinearModel, sensors: Sequence[PlannedSensor]
) -> tuple[Measurement, ...]:
    """Return the measurements of the design: rows of x, each with its age and its noise."""
    n = len(model.states)
    found = []
    for sensor in sensors:
        rows = np.zeros((len(sensor.measures), n))
        for k, name in enumerate(sensor.measures):
            rows[k, model.states.index(name)] = 1.0
        over: Any = "link" if sensor.loss or sensor.jitter else "onboard"
        noise = list(sensor.noise)
        found.append(
            Measurement(sensor.name, rows, sensor.age, any_age=True, noise=noise, over=over)
        )
    return tuple(found)


def _designed(
    whole: LinearModel, settings: FlightSettings, folder: Path, steps: _Steps
) -> tuple[LinearModel, tuple[PlannedSensor, ...], hinf.OutputFeedback]:
    """Return model, sensors and design; where nothing is certified, for a smaller envelope."""
    refused = NotAchievableError("no design was tried")
    for share in _ENVELOPES:
        craft, model = whole.vehicle, whole
        if share < 1.0:
            envelope = {name: share * bound for name, bound in craft.envelope.items()}
            model = linear_model(craft, envelope=envelope)
        sensors = planned_sensors(craft.sensors, model.states, settings)
        measured = measurements_of(model, sensors)
        try:
            design = made_before(model, measured, folder, steps)
            known = known_delays(model.system)
            design = design or hinf.design_output_feedback(
                known, measured, estimated=estimated_states(known)
            )
        except NotAchievableError as error:
            refused = error if share == 1.0 else refused
            continue
        if share < 1.0:
            steps.add(_model_line(model))
            steps.add(f"nothing was certified for the whole envelope: for {share:g} times of it")
        for sensor in sensors:
            steps.add(sensor_line(sensor))
        note = {PLANT_NOTE: plant_note(model).to_json()}
        return model, sensors, replace(design, certificate={**design.certificate, **note})
    refused.hint = "a faster link (--link), a smaller envelope, sensors that are faster on board"
    raise refused


def made_before(
    model: LinearModel, measured: Sequence[Measurement], folder: Path, steps: _Steps
) -> hinf.OutputFeedback | None:
    """Return the design for this model and these measurements that is in the folder, if one is.

    A solver's last digits never decide what flies: a design is kept, and its proof checked again.
    """
    place = folder / DESIGN
    try:
        content = place.read_bytes()
    except OSError:
        return None
    data = hinf.certificate_from_bytes(content, str(place))
    if not _same_question(data, model, measured):
        return None
    found = hinf.design_from_json(data, where=str(place))
    if not isinstance(found, hinf.OutputFeedback):
        return None
    steps.add(f"made before, its proof checked again: {place}")
    return found


def _same_question(data: Any, model: LinearModel, measured: Sequence[Measurement]) -> bool:
    """Whether a certificate is about this plant and these measurements, as far as noise goes."""
    try:
        pair = hinf.pair_from_json(data)
    except (InputError, KeyError, TypeError):
        return False
    given = [(m.name, m.C.tolist(), m.delay(len(model.states)).description) for m in measured]
    own = [
        (m.name, m.C.tolist(), m.delay(len(pair.plant.A)).description) for m in pair.measurements
    ]
    noise = all(
        np.allclose(a.noise, b.noise, rtol=1e-3)  # rounded up, so that products are exact
        for a, b in zip(measured, pair.measurements, strict=False)
    )
    same = hinf.first_difference(known_delays(model.system), pair.plant) is None
    return own == given and noise and same


def known_delays(system: DelaySystem) -> DelaySystem:
    """Return a system with the delays inside the plant constant: an observer must know them."""
    delays = [replace(d, any_age=False) if not d.feedback else d for d in system.delays]
    return replace(system, delays=tuple(delays))


def estimated_states(system: DelaySystem) -> list[bool]:
    """Return which states must be estimated: not what a lag makes of the commands alone."""
    A = np.abs(system.A) + sum((np.abs(d.A) for d in system.delays), np.zeros_like(system.A))
    driven = np.asarray(np.hstack([system.C, system.E]).any(axis=1))
    commanded = np.asarray(system.B.any(axis=1))
    return [bool(driven[i] or not commanded[i] or np.delete(A[i], i).any()) for i in range(len(A))]


def plant_note(model: LinearModel) -> scenario.DesignedPlant:
    """Return how the plant's FMU is seen as the linear model."""
    vehicle, actuation = model.vehicle, model.actuation
    trim = dict(model.trim.state)
    limits = {f"actual.{a.name}": a.limit for a in vehicle.actuators}
    inverse = np.asarray(np.linalg.pinv(actuation.thrust_map), dtype=np.float64)
    own = [name for name in model.states if not name.startswith("acting.")]
    acting = len(own) < len(model.states)
    lagged = [a for a in vehicle.actuators if a.lag] if acting else []
    names = (*own, *(f"actual.{a.name}" for a in lagged))
    rows = np.zeros((len(model.states), len(names)))
    for i, name in enumerate(model.states):
        if name in own:  # an actuator counts in share of its limit
            rows[i, own.index(name)] = 1.0 / limits.get(name, 1.0)
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
        model=fmus.component_module("vehicle_plant.variables").plant_record(vehicle),
        thrust_map=tuple(map(tuple, actuation.thrust_map.tolist())),
    )


def disturbances_of(model: LinearModel) -> tuple[str, ...]:
    """Return the inputs of the plant that are the entries of w."""
    rows = np.argmax(np.abs(model.system.C), axis=0)  # a column for each controlled velocity
    return tuple(f"disturbance.{model.states[i].removeprefix('nu.')}" for i in rows)


def _mission(model: LinearModel, design: hinf.OutputFeedback, settings: FlightSettings) -> Mission:
    return plan_mission(
        design,
        model.states,
        disturbances_of(model),
        model.envelope,
        model.actuation.authority.tolist(),
        settings,
    )


def _save(design: hinf.OutputFeedback, path: Path) -> None:
    data = DESIGN_FILE.stamped(design.to_json())
    path.write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", "utf-8")


def _write_fmus(
    model: LinearModel, mission: Mission, design: hinf.OutputFeedback, folder: Path
) -> list[str]:
    """Write the FMUs of a flight; return their names."""
    kind = fmus.target_named(fmus.DEFAULT_FLAVOUR, "prebuilt")
    data = design.to_json()
    parts = fmus.design_parts(data)
    specs = {part: fmus.design_part_spec(data, part, name=part) for part in parts}
    if mission.set_points:
        points = [(f"set-point of {model.states[i - 1]}", None) for i in mission.set_points]
        sensor_fmu = fmus.component_module("sensor.variables")
        specs["ship"] = sensor_fmu.sensor_spec("ship", points)
    for name, spec in specs.items():
        fmus.write_fmu(spec, folder / f"{name}.fmu", kind)
    return [f"{name}.fmu" for name in specs]


def _write_scenario(
    model: LinearModel,
    sensors: Sequence[PlannedSensor],
    mission: Mission,
    settings: FlightSettings,
    path: Path,
    steps: _Steps,
) -> None:
    """Write the scenario; one that was there and differs is kept beside it."""
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
    if path.exists() and path.read_text("utf-8") != text:
        kept = path.with_suffix(".before.toml")
        path.replace(kept)
        steps.add(f"the scenario that was there is kept: {kept}")
    path.write_text(text, "utf-8")
    if mission.wave_height:
        sea = f"a sea of {mission.wave_height:g} m and {mission.wave_period:g} s"
        steps.add(f"{sea}, met {mission.wave_depth:g} m down")
    offsets = [f"{model.states[i - 1]} {v:+g}" for i, v in mission.set_points.items()]
    steps.add(f"set-points over the link, back to the trim from {', '.join(offsets) or 'there'}")


def _subject(
    model: LinearModel,
    design: hinf.OutputFeedback,
    sensors: Sequence[PlannedSensor],
    mission: Mission,
    outcome: Outcome,
) -> PictureSubject:
    aged = ", ".join(f"{s.name} up to {s.age:g} s old" for s in sensors)
    gamma = "" if design.gamma is None else f"γ = {design.gamma:.3g} certified; "
    return PictureSubject(
        title=f"{model.vehicle.name}: {outcome.headline}",
        subtitle=f"{gamma}{aged}; loop closed on board, set-points over the link",
        states=model.states,
        trim=[model.trim.state.get(name, 0.0) for name in model.states],
        positions=list(mission.set_points),
        ages={s.name: s.age for s in sensors},
        limits={a.command: a.limit for a in model.vehicle.actuators},
    )
