"""Record each kind of behaviour, and name the hand-written C that runs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cosim.fmu.export.components import component_module
from cosim.fmu.export.native.model import NativeModel, behaviour_of, distinct_enumerators
from cosim.fmu.export.native.waves_kind import record_waves
from cosim.fmu.export.python.delay_plant import DelayPlant
from cosim.fmu.export.spec import ComponentSpec
from cosim.tape import Scalar, required_places, tangents

StateFeedback: Any = component_module("hinf_controller.behaviour").StateFeedback
LinkChannel: Any = component_module("link_channel.behaviour").LinkChannel
Computed: Any = component_module("computed.behaviour").Computed
Sensor: Any = component_module("sensor.behaviour").Sensor
SignalTable: Any = component_module("signal_table.behaviour").SignalTable
PythonCode: Any = component_module("python_code.behaviour").PythonCode
Observer: Any = component_module("observer.behaviour").Observer
VehiclePlant: Any = component_module("vehicle_plant.behaviour").VehiclePlant
WatchedFeedback: Any = component_module("hinf_controller.watched").WatchedFeedback
WaveField: Any = component_module("wave_field.behaviour").WaveField

_STATE_AGE = ("stamp.state", "age.state", "message_age.state")
FILES = {
    "plant": ("delay_line.c", "plant.c"),
    "vehicle": ("delay_line.c", "vehicle.c"),
    "observer": ("observer.c", "instance_watched.c"),
    "sampled": ("sampled.c",),
    "sampled_watched": ("sampled_watched.c",),
    "packet_link": ("draws.c", "packet_link.c"),
    "transport_link": ("transport_link.c",),
    "sensor": ("draws.c", "sensor.c"),
    "computed": ("computed.c",),
    "table": ("table.c",),
    "python_code": ("python_code.c",),
    "waves": ("waves.c",),
}
"""Kind of behaviour -> the hand-written C that it alone has."""


def record(spec: ComponentSpec) -> NativeModel:
    """Record a component.

    Raises
    ------
    TypeError : a behaviour that the hand-written C does not support.
    """
    distinct_enumerators(spec)
    behaviour = behaviour_of(spec)
    model = NativeModel(spec)
    for cls, recorder in _RECORDERS.items():
        if isinstance(behaviour, cls):
            model.kind = recorder(model, behaviour)
            if spec.clocks:
                model.numbers["MODEL_CLOCKS"] = len(spec.clocks)
            return model
    raise TypeError(f"{spec.name}: the native shell has no C for {type(behaviour).__name__}")


def _record_delay_plant(model: NativeModel, behaviour: DelayPlant) -> str:
    """Record rates and outputs of a delay equation; see c/plant.c."""
    if isinstance(behaviour, VehiclePlant):
        behaviour.functions = model.ns
    v, n = model.v, len(behaviour.states)
    x = model.symbols("x", n)
    late = [model.symbols("late", n, k * n) for k in range(len(behaviour.delays))]
    u = [v[name] for name in behaviour.inputs]
    constants = behaviour.constants(v)
    rates = behaviour.rates(model.tape.symbol("t"), x, late, u, constants, model.ns)
    outputs = behaviour.outputs(x, u, constants)
    own = [name for name in outputs if name not in behaviour.states]
    change = model.symbols("change", len(behaviour.inputs))
    moved = tangents(
        model.tape,
        [model.tape.scalar(outputs[name]) for name in own],
        {v[name].place: one for name, one in zip(behaviour.inputs, change, strict=True)},
    )
    model.tables |= {
        "model_inputs": behaviour.inputs,
        "model_states": behaviour.states,
        "model_initials": [f"initial.{s}" for s in behaviour.states],
        "model_delays": behaviour.delays,
        "model_others": own,
    }
    used = _used(model, late, [model.tape.scalar(r) for r in rates])
    kind = "plant"
    more: Mapping[str, Sequence[Scalar | float]] = {}
    if isinstance(behaviour, Observer):
        kind = "observer"
        more = _record_observer(model, behaviour, x, constants)
        used = list(range(n))  # measurements are compared with whole estimates
    elif isinstance(behaviour, VehiclePlant) and behaviour.pitch is not None:
        kind = "vehicle"
    model.numbers |= {"LATE_BEGIN": min(used, default=0), "LATE_END": max(used, default=-1) + 1}
    model.conditions = [(model.tape.scalar(one), text) for one, text in behaviour.conditions(v)]
    model.add_programs(
        rates=rates,
        other_outputs=[outputs[name] for name in own],
        outputs_change=[0.0 if m is None else m for m in moved],
        **more,
    )
    return kind


def _record_observer(
    model: NativeModel, behaviour: Any, x: list[Scalar], constants: Any
) -> Mapping[str, Sequence[Scalar | float]]:
    """Record what an observer does at communication points: its programs for c/observer.c."""
    fields = ("stamp.{0}", "age.{0}", "message_age.{0}", "ignored.{0}", "innovation.{0}[1]")
    with_commands = bool(behaviour.commands)
    play = ["watchdog", "command.delay", "age.command"] if with_commands else []
    if play and behaviour.trimmed:
        play += [f"{word}.{name}" for word in ("trim", "safe") for name in behaviour.commands]
    model.tables |= {
        "model_outputs": behaviour.commands,
        "model_measured": [text.format(m.name) for m in behaviour.measured for text in fields],
        "model_acting": behaviour.acting,
        "model_watched": _watched(behaviour.uses),
        "model_play": play,
    }
    model.absent = () if with_commands else ("sample_time",)
    return {
        "compared": behaviour.compared(model.v, x, constants),
        "decided": behaviour.decided(model.v, x, constants, model.ns),
    }


def _used(model: NativeModel, late: list[list[Scalar]], rates: list[Scalar]) -> list[int]:
    """Return the entries of the delayed states that occur in the rates."""
    required = set(required_places(model.tape, [rate.place for rate in rates]))
    return sorted({i for row in late for i, value in enumerate(row) if value.place in required})


def _watched(uses: Sequence[str]) -> list[str]:
    """Name the uses of assumptions at present and at most, and whether they are met."""
    named = [f"{word}.{use}" for word in ("present", "assumption") for use in uses]
    return [*named, "assumption.met"]


def _record_sampled(model: NativeModel, behaviour: Any) -> str:
    """Record the law of a sampled controller; see c/sampled.c."""
    constants = behaviour.constants(model.v)
    outputs = behaviour.law(model.v, constants, model.ns, model.tape.symbol("elapsed"))
    model.tables["model_outputs"] = [*outputs]
    results = {"law": [*outputs.values()]}
    watched = isinstance(behaviour, WatchedFeedback)
    if watched:
        uses = ("age", "envelope", "saturation")
        model.tables |= {"model_measured": _STATE_AGE, "model_watched": _watched(uses)}
        results["decided"] = behaviour.shares(model.v, constants, model.ns)
        conditions = behaviour.conditions(model.v)
        model.conditions = [(model.tape.scalar(bound), text) for bound, text in conditions]
    model.add_programs(**results)
    return "sampled_watched" if watched else "sampled"


def _record_link(model: NativeModel, behaviour: Any) -> str:
    for table, name in (
        ("model_inputs", "u"),
        ("model_outputs", "y"),
        ("model_initials", "initial"),
    ):
        model.tables[table] = [f"{name}[{i}]" for i in range(1, behaviour.signals + 1)]
    if behaviour.kind == "transport":
        return "transport_link"
    names = [v.name for v in model.spec.variables]
    for table, start in (("model_states", "loss.state["), ("model_others", "loss.move[")):
        model.tables[table] = [name for name in names if name.startswith(start)]
    model.text = behaviour.name
    return "packet_link"


def _record_sensor(model: NativeModel, behaviour: Any) -> str:
    """Name the variables of each value of a sensor; see c/sensor.c."""
    for table, role in (
        ("model_inputs", "input"),
        ("model_outputs", "output"),
        ("model_initials", "bias"),
        ("model_others", "noise"),
        ("model_states", "drift"),
        ("model_watched", "resolution"),
        ("model_measured", "least"),
        ("model_acting", "greatest"),
    ):
        model.tables[table] = behaviour.lanes.get(role, [])
    at_once = ("frozen", "freeze.from", "freeze.until", "uniform")
    model.absent = at_once if behaviour.stamped else ("stamp", "offset")
    model.text = behaviour.name
    return "sensor"


def _record_computed(model: NativeModel, behaviour: Any) -> str:
    """Record values computed from signals."""
    results = behaviour.law(model.v, model.tape, model.tape.symbol("elapsed"))
    model.tables |= {"model_inputs": behaviour.inputs, "model_outputs": behaviour.outputs}
    model.add_programs(law=results)
    model.text = "\n".join(behaviour.texts)
    return "computed"


def _record_table(model: NativeModel, behaviour: Any) -> str:
    """Record a table of signals."""
    model.tables["model_outputs"] = behaviour.outputs
    model.rows = behaviour.instants_ns, behaviour.rows
    return "table"


def _record_python_code(model: NativeModel, behaviour: Any) -> str:
    """Name the signals of Python code; its steps are not recorded."""
    model.tables |= {"model_inputs": behaviour.inputs, "model_outputs": behaviour.outputs}
    return "python_code"


_RECORDERS: dict[Any, Callable[[NativeModel, Any], str]] = {
    DelayPlant: _record_delay_plant,
    StateFeedback: _record_sampled,
    WaveField: record_waves,
    LinkChannel: _record_link,
    Sensor: _record_sensor,
    Computed: _record_computed,
    PythonCode: _record_python_code,
    SignalTable: _record_table,
}
"""Class of behaviour -> what records it and says of which kind it is."""
