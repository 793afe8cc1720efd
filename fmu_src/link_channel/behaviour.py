"""What the C of a link has to know when it is built: how many signals pass, and under what name.

What a link does is `cosim.network`; in an FMU it is c/packet_link.c and c/transport_link.c,
which step it message by message. There is no flavour in Python.
"""

from __future__ import annotations

from typing import Any

JITTERS = ("none", "uniform", "exponential", "normal")
"""Kinds of jitter, by the number that the parameter `jitter.kind` has."""

ORDERS = ("newest-wins", "fifo", "as-arrived")
"""Orders of delivery, by the number that the parameter `order` has."""


class LinkChannel:
    """Signals u[1], u[2], ... in, the same ones y[1], y[2], ... out, as the link delivers them.

    Attributes
    ----------
    name : of the link; its random streams depend on it.
    signals : number of signals.
    kind : "packet" or "transport".
    """

    def __init__(self, constants: dict[str, Any]) -> None:
        self.name: str = constants["link"]
        self.signals: int = constants["lanes"]
        self.kind: str = constants["kind"]
