"""The page's example of a flight: plant and controller of Eq. (7), (8) in one scenario."""

from __future__ import annotations

from cosim.fmu.export.decimals import round_below

_COMMENTS = {
    "plant.fmu": "  # cosim fmu build my-system.toml -o plant.fmu",
    "controller.fmu": "  # cosim fmu controller my-design.json -o controller.fmu",
}


def loop_scenario(
    plant: str, controller: str | None, *, feedback_delay: float, step: float, end: float
) -> str:
    """TOML of a flight, over a link as slow as the design allows.

    Parameters
    ----------
    plant, controller : built-in names or files; None for a plant that has no control.
    feedback_delay : age of the measurements that the design allows for [s].
    step, end : greatest communication step and length of the run [s].
    """
    if controller is not None and feedback_delay > 0:
        step = round_below(min(step, feedback_delay / 4))  # so that a link is left beside it
    lines = [
        'title = "Plant and controller"' if controller else 'title = "The plant alone"',
        "",
        "[run]",
        f"end = {end:.12g}",
        f"step = {step:.12g}",
        "",
        "[components.plant]",
        f'fmu = "{plant}"{_COMMENTS.get(plant, "")}',
        'parameters = { "initial.x[1]" = 1.0 }',
    ]
    if controller is None:
        return "\n".join([*lines, ""])
    # the exchange adds a step to what a link delays, and holding the command another
    late = feedback_delay - 2 * step
    linked = late > 0
    lines += [
        "",
        "[components.controller]",
        f'fmu = "{controller}"{_COMMENTS.get(controller, "")}',
        "",
        "[[connections]]",
        'from = "plant.x"',
        'to = "controller.x"',
        *(['link = "uplink"'] if linked else []),
        "",
        "[[connections]]",
        'from = "controller.u"',
        'to = "plant.u"',
    ]
    if linked:
        lines += [
            "",
            f"[links.uplink]  # exchange and hold add a step each: {feedback_delay:g} s in all",
            'kind = "transport"',
            f"delay = {late:.12g}",
        ]
    return "\n".join([*lines, ""])
