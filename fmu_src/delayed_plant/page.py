"""What the documentation page says of one plant: its sizes, its delays, how to fly it."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.models.delay_system import Delay, DelaySystem


def notes(system: DelaySystem, delays: Sequence[Delay], named: Sequence[str], origin: str) -> str:
    """Markdown: sizes, and where each delay of the system is found.

    Parameters
    ----------
    delays, named : those that belong to the plant, and their parameters.
    origin : where the numbers are from, a sentence.
    """
    n, m = system.B.shape
    p, q = system.D1.shape
    sizes = [
        f"{n} state{_s(n)} x",
        f"{m} control{_s(m)} u",
        f"{q} disturbance{_s(q)} w",
        f"{p} performance output{_s(p)} z",
    ]
    uncertain = f"F(t) is {system.E.shape[1]} x {system.H.shape[0]}"
    lines = [
        "## This plant",
        "",
        " ".join(
            part
            for part in (
                ", ".join(sizes) + ";",
                f"{uncertain}." if system.E.size else "nothing is uncertain: no E, F, H.",
                origin,
            )
            if part
        ),
        "",
    ]
    if not system.delays:
        return "\n".join([*lines, "It has no delay.", ""])
    lines += ["| delay | where it is |", "|---|---|"]
    parameters = {id(delay): i for i, delay in enumerate(delays)}
    for delay in system.delays:
        lines.append(f"| {delay.d:g} s | {_place(delay, parameters, named)} |")
    return "\n".join([*lines, ""])


def _place(delay: Delay, parameters: dict[int, int], named: Sequence[str]) -> str:
    parts = []
    if id(delay) in parameters:
        number = parameters[id(delay)] + 1
        age = " (constant here, where the design allows every age up to it)"
        parts.append(
            f"in the plant: A{number} x(t − d), d = `{named[number - 1]}`"
            + (age if delay.any_age and not delay.feedback else "")
        )
    if delay.feedback:
        parts.append(
            "between the plant and its controller: u = K x(t − d). It is **not** in this FMU, "
            "where u acts at once; link, sampling and exchange together make it up"
        )
    return "; and ".join(parts)


def scenario(system: DelaySystem, name: str, controller: str, step: float, end: float) -> str:
    """TOML of a flight of this plant with a controller, over the link that its design allows."""
    lines = [
        f'title = "{name} with its controller"' if system.B.size else f'title = "{name}"',
        "",
        "[run]",
        f"end = {end:g}",
        f"step = {step:g}",
        "",
        "[components.plant]",
        f'fmu = "{name}{"" if name == "DelayedPlant" else ".fmu"}"',
        'parameters = { "initial.x[1]" = 1.0 }',
    ]
    if not system.B.size:
        return "\n".join([*lines, ""])
    built_in = controller[0].isupper()
    lines += [
        "",
        "[components.controller]",
        f'fmu = "{controller}{"" if built_in else ".fmu"}"'
        + ("" if built_in else "  # cosim fmu controller my-design.json -o controller.fmu"),
        "",
        "[[connections]]",
        'from = "plant.x"',
        'to = "controller.x"',
    ]
    late = system.feedback_delay - 2 * step
    if late > 0:
        lines.append('link = "uplink"')
    lines += ["", "[[connections]]", 'from = "controller.u"', 'to = "plant.u"']
    if late > 0:
        lines += [
            "",
            f"[links.uplink]  # with exchange and hold, a step each: {system.feedback_delay:g} s",
            'kind = "transport"',
            f"delay = {late:.12g}",
        ]
    return "\n".join([*lines, ""])


def _s(count: int) -> str:
    return "" if count == 1 else "s"
