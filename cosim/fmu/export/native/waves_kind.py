"""Record the equations of one bin and one harmonic of the sea; the loops are in c/waves.c."""

from __future__ import annotations

import textwrap
from typing import Any

from cosim.fmu.export.components import component_module
from cosim.fmu.export.native.c_model import ModelWriter
from cosim.models import waves

_WAVE_FIELD = component_module("wave_field.behaviour")


def record_waves(writer: ModelWriter, behaviour: Any) -> None:
    """Record bins, harmonics, gains and accelerations of the sea."""
    v, ns, symbol = writer.v, writer.ns, writer.tape.symbol
    most = max(int(x.maximum or 0) for x in writer.spec.variables if x.name == "components")
    writer.references("model_outputs", _WAVE_FIELD.OUTPUTS, "MODEL_OUTPUTS")
    writer.define("MODEL_CONSTANTS", 0)
    writer.define("MODEL_MOST_HARMONICS", max(most, behaviour.slots))
    writer.define("MODEL_SLOTS", behaviour.slots)
    for number, name in _WAVE_FIELD.SPECTRA.items():
        writer.define(f"SPECTRUM_{name.upper().replace('-', '_')}", number)
    writer.define("PIERSON_MOSKOWITZ_PEAK", repr(waves.PEAK_FACTOR["pierson-moskowitz"]))
    for field in ("omega", "amplitude", "phase"):
        names = [f"{field}[{k}]" for k in range(1, behaviour.slots + 1)]
        writer.references(f"model_{field}", names, f"MODEL_{field.upper()}_SLOTS")
    below = ", ".join(str(waves.bins_below_peak(count)) for count in range(most + 1))
    table = f"const unsigned char model_bins_below_peak[{most + 1}]"
    writer.header.append(f"extern {table};")
    writer.body.append(textwrap.fill(f"{table} = {{{below}}};", 100, subsequent_indent="    "))

    k, count, under, drawn = (symbol(s) for s in ("k", "count", "below", "drawn"))
    peak = symbol("peak")
    for name, drawn_bin in (
        ("lower", waves.lower_bin(k, under, drawn, v["Tp"], peak, ns)),
        ("upper", waves.upper_bin(k, under, count, drawn, v["Tp"], peak, ns)),
    ):
        writer.function(
            f"void model_{name}_bin(const double *v, double k, double below, double count,\n"
            "                     double drawn, double peak, double *out)",
            [("out[0]", drawn_bin[0]), ("out[1]", drawn_bin[1])],
        )
    wave = waves.harmonic(
        symbol("omega"), symbol("own"), symbol("energy"), v["Hs"], symbol("drawn"), ns
    )
    wave = waves.acceleration_at_depth(wave, v["depth"], ns)
    writer.function(
        "void model_harmonic(const double *v, double omega, double own, double energy,\n"
        "                    double drawn, Harmonic *h)",
        [("h->omega", wave.omega), ("h->amplitude", wave.amplitude), ("h->phase", wave.phase)],
    )
    for name, gain in (("explicit", behaviour.factors(v)), ("sea", behaviour.gains(v, ns))):
        writer.function(
            f"void model_{name}_gains(const double *v, double *gain)",
            [(f"gain[{i}]", value) for i, value in enumerate(gain)],
        )
    own = waves.Component(symbol("h->omega"), symbol("h->amplitude"), symbol("h->phase"))
    along, down = waves.with_harmonic(symbol("sum[0]"), symbol("sum[1]"), symbol("t"), own, ns)
    writer.function(
        "void model_add_harmonic(double t, const Harmonic *h, double *sum)",
        [("sum[0]", along), ("sum[1]", down)],
    )
    shares = waves.shares(
        symbol("sum[0]"), symbol("sum[1]"), waves.Gains(*writer.symbols("gain", 4))
    )
    writer.function(
        "void model_shares(const double *sum, const double *gain, double *out)",
        [(f"out[{i}]", value) for i, value in enumerate(shares)],
    )
    writer.header.insert(0, "typedef struct {\n    double omega, amplitude, phase;\n} Harmonic;\n")
