"""The page's example run: plant and controller of Eq. (7), (8) in one scenario."""

from __future__ import annotations

import math

_COMMENTS = {
    "plant.fmu": "  # cosim fmu build my-system.toml -o plant.fmu",
    "controller.fmu": "  # cosim fmu controller my-design.json -o controller.fmu",
}


def round_below(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is at most `value` > 0."""
    exponent = math.floor(math.log10(value))
    # from decimal text, so that they print as short numbers
    found = [float(f"{digit}e{exponent + more}") for more in (-1, 0) for digit in (1, 2, 5)]
    return max(number for number in found if number <= value)


def loop_scenario(
    plant: str, controller: str | None, *, feedback_delay: float, step: float, end: float
) -> str:
    """Return the TOML of a run over a link as slow as the design allows.

    Parameters
    ----------
    plant, controller : built-in names or files; no controller for a plant without control.
    feedback_delay : greatest age of measurements that the design allows [s].
    step, end : greatest communication step and length of the run [s].
    """
    if controller is not None and feedback_delay > 0:
        step = round_below(min(step, feedback_delay / 4))  # leaves some of the delay to the link
    text = f"""\
title = "{"The plant alone" if controller is None else "Plant and controller"}"

[run]
end = {end:.12g}
step = {step:.12g}

[components.plant]
fmu = "{plant}"{_COMMENTS.get(plant, "")}
parameters = {{ "initial.x[1]" = 1.0 }}
"""
    if controller is None:
        return text
    # the exchange adds one step to the delay of the link, and holding the command another
    late = feedback_delay - 2 * step
    link = 'link = "uplink"\n' if late > 0 else ""
    text += f"""
[components.controller]
fmu = "{controller}"{_COMMENTS.get(controller, "")}

[[connections]]
from = "plant.x"
to = "controller.x"
{link}
[[connections]]
from = "controller.u"
to = "plant.u"
"""
    if late > 0:
        text += f"""
[links.uplink]  # exchange and hold add a step each: {feedback_delay:g} s in all
kind = "transport"
delay = {late:.12g}
"""
    return text
