"""The documentation page's notes on a plant: its dimensions and the places of its delays."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.models import Delay, DelaySystem


def notes(system: DelaySystem, delays: Sequence[Delay], named: Sequence[str], origin: str) -> str:
    """Return the dimensions and the place of each delay of the system as Markdown.

    Parameters
    ----------
    delays, named : those in the plant, and their parameters.
    origin : a sentence on the origin of the numbers.
    """
    n, m = system.B.shape
    p, q = system.D1.shape
    sizes = [
        f"{n} state{_s(n)} x",
        f"{m} control{_s(m)} u",
        f"{q} disturbance{_s(q)} w",
        f"{p} performance output{_s(p)} z",
    ]
    uncertain = f"F(t) is {system.E.shape[1]} × {system.H.shape[0]}"
    sentences = [
        ", ".join(sizes) + ";",
        f"{uncertain}." if system.E.size else "nothing is uncertain: no E, F, H.",
        origin,
        "They have the units of that system; time is in seconds.",
    ]
    lines = ["## This plant", "", " ".join(part for part in sentences if part), ""]
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
            "where u acts at once; link, sampling and exchange together cause it"
        )
    return "; and ".join(parts)


def _s(count: int) -> str:
    return "" if count == 1 else "s"
