"""Record each kind of behaviour as C, and name the hand-written C that runs it."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import Any, get_args

from cosim.fmu.export.components import component_module
from cosim.fmu.export.native.c_model import (
    ModelWriter,
    behaviour_of,
    c_string,
    distinct_enumerators,
)
from cosim.fmu.export.native.link_step import link_step_header
from cosim.fmu.export.native.waves_kind import record_waves
from cosim.fmu.export.python.delay_plant import DelayPlant
from cosim.fmu.export.spec import ComponentSpec
from cosim.network import Order
from cosim.tape import Scalar, required_places, tangents

StateFeedback: Any = component_module("hinf_controller.behaviour").StateFeedback
LinkChannel: Any = component_module("link_channel.behaviour").LinkChannel
Computed: Any = component_module("computed.behaviour").Computed
PlainSensor: Any = component_module("plain_sensor.behaviour").PlainSensor
Sensor: Any = component_module("sensor.behaviour").Sensor
SignalTable: Any = component_module("signal_table.behaviour").SignalTable
Observer: Any = component_module("observer.behaviour").Observer
VehiclePlant: Any = component_module("vehicle_plant.behaviour").VehiclePlant
WatchedFeedback: Any = component_module("hinf_controller.watched").WatchedFeedback
WaveField: Any = component_module("wave_field.behaviour").WaveField

_DECIDED = "void model_{}(const double *x, const double *v, const double *c, double *out)"
_STATE_AGE = ("stamp.state", "age.state", "message_age.state")

COMMON = ("message.c", "instance.c", "saved.c")
CLOCKED = {"sampled.c": "sampled_clocked.c", "packet_link.c": "packet_link_clocked.c"}
"""C file of a kind of behaviour -> the one that has Clocks, and includes it."""


def model_files(spec: ComponentSpec, identity: str) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the recorded C by file name, and the names of the hand-written C beside `COMMON`.

    Raises
    ------
    TypeError : a behaviour that the C shell does not support.
    """
    writer, sources = recorded_model(spec)
    return {**writer.files(identity), **shared_headers(sources)}, sources


def shared_headers(sources: Sequence[str]) -> dict[str, str]:
    """Return the generated headers that the hand-written C needs, by file name."""
    linked = any(name in sources for name in ("packet_link.c", "packet_link_clocked.c"))
    return {"link_step.h": link_step_header()} if linked else {}


def recorded_model(spec: ComponentSpec) -> tuple[ModelWriter, tuple[str, ...]]:
    """Record a component; return that, and the names of the hand-written C beside `COMMON`.

    Raises
    ------
    TypeError : a behaviour that the C shell does not support.
    """
    distinct_enumerators(spec)
    behaviour = behaviour_of(spec)
    writer = ModelWriter(spec)
    if isinstance(behaviour, DelayPlant):
        if isinstance(behaviour, VehiclePlant):
            behaviour.functions = writer.ns
        record_delay_plant(writer, behaviour)
        watched = isinstance(behaviour, VehiclePlant) and behaviour.pitch is not None
        sources: tuple[str, ...] = ("delay_line.c", "vehicle.c" if watched else "plant.c")
        if isinstance(behaviour, Observer):
            sources = ("observer.c", "instance_watched.c")
    elif isinstance(behaviour, StateFeedback):
        record_sampled(writer, behaviour)
        watches = isinstance(behaviour, WatchedFeedback)
        sources = ("sampled_watched.c" if watches else "sampled.c",)
    elif type(behaviour) in _RECORDS:
        sources = _RECORDS[type(behaviour)](writer, behaviour)
    else:
        raise TypeError(f"{spec.name}: the native shell has no C for {type(behaviour).__name__}")
    if spec.clocks:
        writer.define("MODEL_CLOCKS", len(spec.clocks))
        sources = tuple(CLOCKED.get(name, name) for name in sources)
    return writer, sources


def record_delay_plant(writer: ModelWriter, behaviour: DelayPlant) -> None:
    """Record rates and outputs of a delay equation; see c/plant.c."""
    v, n = writer.v, len(behaviour.states)
    x = writer.symbols("x", n)
    late = [writer.symbols("late", n, k * n) for k in range(len(behaviour.delays))]
    u = [v[name] for name in behaviour.inputs]
    constants = behaviour.constants(v)
    rates = behaviour.rates(writer.tape.symbol("t"), x, late, u, constants, writer.ns)
    outputs = behaviour.outputs(x, u, constants)
    own = [name for name in outputs if name not in behaviour.states]
    change = {name: writer.tape.symbol(f"change[{i}]") for i, name in enumerate(behaviour.inputs)}
    moved = tangents(
        writer.tape,
        [writer.tape.scalar(outputs[name]) for name in own],
        {v[name].place: change[name] for name in behaviour.inputs},
    )

    writer.define("MODEL_STATES", n)
    writer.references("model_inputs", behaviour.inputs, "MODEL_INPUTS")
    writer.references("model_states", behaviour.states, "MODEL_STATE_OUTPUTS")
    writer.references(
        "model_initials", [f"initial.{s}" for s in behaviour.states], "MODEL_INITIALS"
    )
    writer.references("model_delays", behaviour.delays, "MODEL_DELAYS")
    writer.references("model_others", own, "MODEL_OTHERS")
    writer.define("MODEL_STEP", "V_solver_step")
    used = _used(writer, late, [writer.tape.scalar(r) for r in rates])
    more: list[tuple[str, list[tuple[str, Scalar]]]] = []
    if isinstance(behaviour, Observer):
        more = record_observer(writer, behaviour, x, constants)
        used = list(range(n))  # measurements are compared with whole estimates
    writer.define("LATE_BEGIN", min(used, default=0))
    writer.define("LATE_END", max(used, default=-1) + 1)
    targets = [(f"dx[{i}]", writer.tape.scalar(rate)) for i, rate in enumerate(rates)]
    others = [(f"out[{i}]", writer.tape.scalar(outputs[name])) for i, name in enumerate(own)]
    changed = [
        (f"out[{i}]", writer.tape.constant(0.0) if m is None else m) for i, m in enumerate(moved)
    ]
    own_targets = [target for _, listed in more for target in listed]
    writer.hoist([value for _, value in (*targets, *others, *changed, *own_targets)])
    writer.parameter_check(
        [(writer.tape.scalar(quantity), text) for quantity, text in behaviour.conditions(v)]
    )
    writer.function(
        "void model_rates(double t, const double *x, const double *late, const double *v,\n"
        "                 const double *c, double *dx)",
        targets,
        hoisted=True,
    )
    writer.function(
        "void model_other_outputs(const double *x, const double *v, const double *c, double *out)",
        others,
        hoisted=True,
    )
    writer.function(
        "void model_outputs_change(const double *x, const double *v, const double *c,\n"
        "                          const double *change, double *out)",
        changed,
        hoisted=True,
    )
    for signature, listed in more:
        writer.function(signature, listed, hoisted=True)


def record_observer(
    writer: ModelWriter, behaviour: Any, x: list[Scalar], constants: Any
) -> list[tuple[str, list[tuple[str, Scalar]]]]:
    """Record what an observer does at communication points: its functions for c/observer.c."""
    fields = ("stamp.{0}", "age.{0}", "message_age.{0}", "ignored.{0}", "innovation.{0}[1]")
    measured = [text.format(one.name) for one in behaviour.measured for text in fields]
    with_commands = bool(behaviour.commands)
    writer.references("model_outputs", behaviour.commands, "MODEL_OUTPUTS")
    writer.references("model_measured", measured, "MODEL_MEASURED")
    writer.references("model_acting", behaviour.acting, "MODEL_ACTING")
    _record_watched(writer, behaviour.uses)
    play = ["watchdog", "command.delay", "age.command"] if with_commands else []
    if play and behaviour.trimmed:
        play += [f"{word}.{name}" for word in ("trim", "safe") for name in behaviour.commands]
    writer.references("model_play", play, "MODEL_PLAY")
    writer.define("MODEL_SAMPLE_TIME", "V_sample_time" if with_commands else 0)
    compared = behaviour.compared(writer.v, x, constants)
    decided = behaviour.decided(writer.v, x, constants, writer.ns)
    return [
        (_DECIDED.format("compared"), _results(writer, compared)),
        (_DECIDED.format("decided"), _results(writer, decided)),
    ]


def _used(writer: ModelWriter, late: list[list[Scalar]], rates: list[Scalar]) -> list[int]:
    """Return the entries of the delayed states that occur in the rates."""
    required = set(required_places(writer.tape, [rate.place for rate in rates]))
    return sorted({i for row in late for i, value in enumerate(row) if value.place in required})


def record_sampled(writer: ModelWriter, behaviour: Any) -> None:
    """Record the law of a sampled controller; see c/sampled.c."""
    signature = "void model_law(const double *v, const double *c, double *out)"
    elapsed: Scalar | float = 0.0
    if behaviour.integrals:
        elapsed = writer.tape.symbol("elapsed")
        signature = "void model_law(double elapsed, const double *v, const double *c, double *out)"
        writer.define("MODEL_INTEGRALS", len(behaviour.integrals))
    outputs = behaviour.law(writer.v, behaviour.constants(writer.v), writer.ns, elapsed)
    writer.references("model_outputs", list(outputs), "MODEL_OUTPUTS")
    writer.define("MODEL_SAMPLE_TIME", "V_sample_time")
    targets = _results(writer, list(outputs.values()))
    shares: list[tuple[str, Scalar]] = []
    if isinstance(behaviour, WatchedFeedback):
        writer.references("model_measured", _STATE_AGE, "MODEL_MEASURED")
        _record_watched(writer, ("age", "envelope", "saturation"))
        constants = behaviour.constants(writer.v)
        shares = _results(writer, behaviour.shares(writer.v, constants, writer.ns))
        conditions = behaviour.conditions(writer.v)
    writer.hoist([value for _, value in (*targets, *shares)])
    writer.function(signature, targets, hoisted=True)
    if shares:
        writer.parameter_check([(writer.tape.scalar(bound), text) for bound, text in conditions])
        writer.function(_DECIDED.format("decided"), shares, hoisted=True)


def _record_watched(writer: ModelWriter, uses: Sequence[str]) -> None:
    """Name the uses of assumptions at present and at most, and whether they are met."""
    named = [f"{word}.{use}" for word in ("present", "assumption") for use in uses]
    writer.references("model_watched", [*named, "assumption.met"], "MODEL_WATCHED")


def _results(writer: ModelWriter, values: Sequence[Scalar | float]) -> list[tuple[str, Scalar]]:
    return [(f"out[{i}]", writer.tape.scalar(value)) for i, value in enumerate(values)]


def record_link(writer: ModelWriter, behaviour: Any) -> tuple[str, ...]:
    """Record a link; return the names of its C files."""
    numbers = range(1, behaviour.signals + 1)
    for array, name, size in (
        ("model_inputs", "u", "MODEL_LANES"),
        ("model_outputs", "y", "MODEL_OUTPUTS"),
        ("model_initials", "initial", "MODEL_INITIALS"),
    ):
        writer.references(array, [f"{name}[{i}]" for i in numbers], size)
    if behaviour.kind == "transport":
        return ("transport_link.c",)
    names = [v.name for v in writer.spec.variables]
    for array, start, size in (
        ("model_states", "loss.state[", "MODEL_STATES"),
        ("model_others", "loss.move[", "MODEL_OTHERS"),
    ):
        writer.references(array, [name for name in names if name.startswith(start)], size)
    for number, order in enumerate(get_args(Order)):
        writer.define(f"ORDER_{order.upper().replace('-', '_')}", number)
    writer.header.append("extern const char model_link_name[];")
    writer.body.append(f"const char model_link_name[] = {c_string(behaviour.name)};")
    return ("draws.c", "packet_link.c")


def record_sensor(writer: ModelWriter, behaviour: Any) -> tuple[str, ...]:
    """Record a sensor; return the names of its C files."""
    numbers = range(1, behaviour.count + 1)
    for array, name, size in (
        ("model_inputs", "u", "MODEL_LANES"),
        ("model_outputs", "y", "MODEL_OUTPUTS"),
        ("model_initials", "bias", "MODEL_INITIALS"),
        ("model_others", "noise", "MODEL_OTHERS"),
    ):
        writer.references(array, [f"{name}[{i}]" for i in numbers], size)
    writer.header.append("extern const char model_link_name[];")
    writer.body.append(f"const char model_link_name[] = {c_string(behaviour.name)};")
    return ("draws.c", "sensor.c")


def record_plain_sensor(writer: ModelWriter, behaviour: Any) -> tuple[str, ...]:
    """Record a sensor on a plain connection; return the names of its C files."""
    for array, fault, size in (
        ("model_inputs", "true.", "MODEL_LANES"),
        ("model_outputs", "", "MODEL_OUTPUTS"),
        ("model_initials", "bias.", "MODEL_INITIALS"),
        ("model_others", "noise.", "MODEL_OTHERS"),
        ("model_states", "drift.", "MODEL_STATES"),
        ("model_watched", "resolution.", "MODEL_WATCHED"),
        ("model_measured", "least.", "MODEL_MEASURED"),
        ("model_acting", "greatest.", "MODEL_ACTING"),
    ):
        writer.references(array, [f"{fault}{name}" for name in behaviour.values], size)
    writer.header.append("extern const char model_link_name[];")
    writer.body.append(f"const char model_link_name[] = {c_string(behaviour.name)};")
    return ("draws.c", "plain_sensor.c")


class _Recorded:
    """Carries out operations by recording them."""

    def __init__(self, writer: ModelWriter) -> None:
        self.apply = writer.tape.apply


_COMPARED = """
static inline double less(double a, double b) { return a < b; }
static inline double less_equal(double a, double b) { return a <= b; }
static inline double equal(double a, double b) { return a == b; }
"""


def record_computed(writer: ModelWriter, behaviour: Any) -> tuple[str, ...]:
    """Record values computed from signals; return the names of its C files."""
    elapsed = writer.tape.symbol("elapsed")
    results = behaviour.law(writer.v, _Recorded(writer), elapsed)
    writer.references("model_inputs", behaviour.inputs, "MODEL_INPUTS")
    writer.references("model_outputs", behaviour.outputs, "MODEL_OUTPUTS")
    targets = _results(writer, results)
    writer.hoist([value for _, value in targets])
    writer.header.append(_COMPARED)
    writer.header.append("extern const char model_link_name[];")
    texts = c_string("\n".join(behaviour.texts))
    writer.body.append(f"const char model_link_name[] = {texts};")
    signature = "void model_law(double elapsed, const double *v, const double *c, double *out)"
    writer.function(signature, targets, hoisted=True)
    return ("computed.c",)


def record_table(writer: ModelWriter, behaviour: Any) -> tuple[str, ...]:
    """Record a table of signals; return the names of its C files."""
    count, width = len(behaviour.rows), len(behaviour.outputs)
    writer.references("model_outputs", behaviour.outputs, "MODEL_OUTPUTS")
    writer.define("MODEL_ROWS", count)
    writer.header.append("extern const int64_t model_instants[MODEL_ROWS];")
    writer.rows = behaviour.instants_ns, behaviour.rows
    writer.header.append(f"extern const double model_table[MODEL_ROWS * {width}];")
    instants = ", ".join(f"INT64_C({t})" for t in behaviour.instants_ns)
    listed = textwrap.fill(instants, 100, initial_indent="    ", subsequent_indent="    ")
    writer.body.append(f"const int64_t model_instants[MODEL_ROWS] = {{\n{listed}\n}};\n")
    rows = "\n".join(f"    {', '.join(map(repr, row))}," for row in behaviour.rows)
    writer.body.append(f"const double model_table[MODEL_ROWS * {width}] = {{\n{rows}\n}};\n")
    writer.header.insert(0, "#include <stdint.h>\n")
    return ("table.c",)


def _waves(writer: ModelWriter, behaviour: Any) -> tuple[str, ...]:
    record_waves(writer, behaviour)
    return ("waves.c",)


_RECORDS: dict[Any, Callable[[ModelWriter, Any], tuple[str, ...]]] = {
    WaveField: _waves,
    LinkChannel: record_link,
    Sensor: record_sensor,
    PlainSensor: record_plain_sensor,
    Computed: record_computed,
    SignalTable: record_table,
}
