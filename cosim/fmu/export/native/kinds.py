"""How each kind of behaviour is recorded, and which hand-written C runs it."""

from __future__ import annotations

from typing import Any

from cosim.fmu.export.components import component_module
from cosim.fmu.export.native.emit import reachable
from cosim.fmu.export.native.link_kind import record_link, record_table
from cosim.fmu.export.native.model import Draft, behaviour_of, distinct_enumerators
from cosim.fmu.export.native.recorder import Scalar
from cosim.fmu.export.native.tangent import tangents
from cosim.fmu.export.native.waves_kind import record_waves
from cosim.fmu.export.python.delay_plant import DelayPlant
from cosim.fmu.export.spec import ComponentSpec

StateFeedback: Any = component_module("hinf_controller.behaviour").StateFeedback
LinkChannel: Any = component_module("link_channel.behaviour").LinkChannel
SignalTable: Any = component_module("signal_table.behaviour").SignalTable
WaveField: Any = component_module("wave_field.behaviour").WaveField

COMMON = ("message.c", "instance.c", "saved.c")


def model_files(spec: ComponentSpec, identity: str) -> tuple[dict[str, str], tuple[str, ...]]:
    """model.h and model.c, and the names of the hand-written C files beside the common ones.

    Raises
    ------
    TypeError : a behaviour of a kind that the C shell does not know.
    """
    distinct_enumerators(spec)
    behaviour = behaviour_of(spec)
    draft = Draft(spec)
    if isinstance(behaviour, DelayPlant):
        record_delay_plant(draft, behaviour)
        sources: tuple[str, ...] = ("delay_line.c", "plant.c")
    elif isinstance(behaviour, StateFeedback):
        record_sampled(draft, behaviour)
        sources = ("sampled.c",)
    elif isinstance(behaviour, WaveField):
        record_waves(draft, behaviour)
        sources = ("waves.c",)
    elif isinstance(behaviour, LinkChannel):
        sources = record_link(draft, behaviour)
    elif isinstance(behaviour, SignalTable):
        sources = record_table(draft, behaviour)
    else:
        raise TypeError(f"{spec.name}: the native shell has no C for {type(behaviour).__name__}")
    return draft.files(identity), sources


def record_delay_plant(draft: Draft, behaviour: DelayPlant) -> None:
    """Rates and outputs of a delay equation; see c/plant.c."""
    v, n = draft.v, len(behaviour.states)
    x = draft.symbols("x", n)
    late = [draft.symbols("late", n, k * n) for k in range(len(behaviour.delays))]
    u = [v[name] for name in behaviour.inputs]
    constants = behaviour.constants(v)
    rates = behaviour.rates(draft.tape.symbol("t"), x, late, u, constants, draft.ns)
    outputs = behaviour.outputs(x, u, constants)
    own = [name for name in outputs if name not in behaviour.states]
    change = {name: draft.tape.symbol(f"change[{i}]") for i, name in enumerate(behaviour.inputs)}
    moved = tangents(
        draft.tape,
        [_scalar(draft, outputs[name]) for name in own],
        {v[name].place: change[name] for name in behaviour.inputs},
    )

    draft.define("MODEL_STATES", n)
    draft.references("model_inputs", behaviour.inputs, "MODEL_INPUTS")
    draft.references("model_states", behaviour.states, "MODEL_STATE_OUTPUTS")
    draft.references("model_initials", [f"initial.{s}" for s in behaviour.states], "MODEL_INITIALS")
    draft.references("model_delays", behaviour.delays, "MODEL_DELAYS")
    draft.references("model_others", own, "MODEL_OTHERS")
    draft.define("MODEL_STEP", "V_solver_step")
    used = _used(draft, late, [_scalar(draft, r) for r in rates])
    draft.define("LATE_BEGIN", min(used, default=0))
    draft.define("LATE_END", max(used, default=-1) + 1)
    targets = [(f"dx[{i}]", _scalar(draft, rate)) for i, rate in enumerate(rates)]
    others = [(f"out[{i}]", _scalar(draft, outputs[name])) for i, name in enumerate(own)]
    changed = [
        (f"out[{i}]", draft.tape.constant(0.0) if m is None else m) for i, m in enumerate(moved)
    ]
    draft.hoist([value for _, value in (*targets, *others, *changed)])
    draft.objection(
        [(_scalar(draft, quantity), text) for quantity, text in behaviour.conditions(v)]
    )
    draft.function(
        "void model_rates(double t, const double *x, const double *late, const double *v,\n"
        "                 const double *c, double *dx)",
        targets,
        hoisted=True,
    )
    draft.function(
        "void model_outputs(const double *x, const double *v, const double *c, double *out)",
        others,
        hoisted=True,
    )
    draft.function(
        "void model_outputs_change(const double *x, const double *v, const double *c,\n"
        "                          const double *change, double *out)",
        changed,
        hoisted=True,
    )


def _scalar(draft: Draft, value: Scalar | float) -> Scalar:
    return value if isinstance(value, Scalar) else draft.tape.constant(value)


def _used(draft: Draft, late: list[list[Scalar]], rates: list[Scalar]) -> list[int]:
    """Which entries of the delayed states occur in the rates."""
    reached = set(reachable(draft.tape, [rate.place for rate in rates], {}))
    return sorted({i for row in late for i, value in enumerate(row) if value.place in reached})


def record_sampled(draft: Draft, behaviour: Any) -> None:
    """The law of a sampled controller; see c/sampled.c."""
    outputs = behaviour.law(draft.v, behaviour.constants(draft.v), draft.ns)
    draft.references("model_outputs", list(outputs), "MODEL_OUTPUTS")
    draft.define("MODEL_SAMPLE_TIME", "V_sample_time")
    targets = [(f"out[{i}]", _scalar(draft, value)) for i, value in enumerate(outputs.values())]
    draft.hoist([value for _, value in targets])
    draft.function(
        "void model_law(const double *v, const double *c, double *out)", targets, hoisted=True
    )
