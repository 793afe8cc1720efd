"""Record the equations of one bin and one harmonic of the sea; the loops are in c/waves.c."""

from __future__ import annotations

import textwrap
from typing import Any

from cosim.fmu.export.components import component_module
from cosim.fmu.export.native.model import NativeModel, Program
from cosim.models import waves

_WAVE_FIELD = component_module("wave_field.behaviour")
_HARMONIC = "typedef struct {\n    double omega, amplitude, phase;\n} Harmonic;\n"


def record_waves(model: NativeModel, behaviour: Any) -> str:
    """Record bins, harmonics, gains and accelerations of the sea; return the kind."""
    v, ns, symbol = model.v, model.ns, model.tape.symbol
    most = max(int(x.maximum or 0) for x in model.spec.variables if x.name == "components")
    model.tables["model_outputs"] = _WAVE_FIELD.OUTPUTS
    model.numbers |= {
        "MODEL_MOST_HARMONICS": max(most, behaviour.slots),
        "MODEL_SLOTS": behaviour.slots,
        **{
            f"SPECTRUM_{name.upper().replace('-', '_')}": number
            for number, name in _WAVE_FIELD.SPECTRA.items()
        },
        "PIERSON_MOSKOWITZ_PEAK": repr(waves.PEAK_FACTOR["pierson-moskowitz"]),
    }
    for field in ("omega", "amplitude", "phase"):
        names = [f"{field}[{k}]" for k in range(1, behaviour.slots + 1)]
        model.tables[f"model_{field}"] = names
    below = ", ".join(str(waves.bins_below_peak(count)) for count in range(most + 1))
    table = f"const unsigned char model_bins_below_peak[{most + 1}]"
    filled = textwrap.fill(f"{table} = {{{below}}};", 100, subsequent_indent="    ")
    model.own += [(_HARMONIC, ""), (f"extern {table};", filled)]

    def add(name: str, parameters: str, targets: Any) -> None:
        model.programs[f"model_{name}"] = Program(parameters, [*targets], hoisted=False)
        model.own.append((f"void model_{name}({parameters});", ""))

    k, count, under, drawn = (symbol(s) for s in ("k", "count", "below", "drawn"))
    peak = symbol("peak")
    counted = "const double *v, double k, double below, double count, double drawn, double peak"
    for name, (omega, width) in {
        "lower": waves.lower_bin(k, under, drawn, v["Tp"], peak, ns),
        "upper": waves.upper_bin(k, under, count, drawn, v["Tp"], peak, ns),
    }.items():
        add(f"{name}_bin", f"{counted}, double *out", [("out[0]", omega), ("out[1]", width)])
    wave = waves.harmonic(
        symbol("omega"), symbol("own"), symbol("energy"), v["Hs"], symbol("drawn"), ns
    )
    wave = waves.acceleration_at_depth(wave, v["depth"], ns)
    add(
        "harmonic",
        "const double *v, double omega, double own, double energy, double drawn, Harmonic *h",
        [("h->omega", wave.omega), ("h->amplitude", wave.amplitude), ("h->phase", wave.phase)],
    )
    for name, gain in (("explicit", behaviour.factors(v)), ("sea", behaviour.gains(v, ns))):
        targets = [(f"gain[{i}]", value) for i, value in enumerate(gain)]
        add(f"{name}_gains", "const double *v, double *gain", targets)
    own = waves.Component(symbol("h->omega"), symbol("h->amplitude"), symbol("h->phase"))
    along, down = waves.with_harmonic(symbol("sum[0]"), symbol("sum[1]"), symbol("t"), own, ns)
    targets = [("sum[0]", along), ("sum[1]", down)]
    add("add_harmonic", "double t, const Harmonic *h, double *sum", targets)
    shares = waves.shares(
        symbol("sum[0]"), symbol("sum[1]"), waves.Gains(*model.symbols("gain", 4))
    )
    targets = [(f"out[{i}]", value) for i, value in enumerate(shares)]
    add("shares", "const double *sum, const double *gain, double *out", targets)
    return "waves"
