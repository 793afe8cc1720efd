"""What the C of a link needs when it is built: the number of signals and the link's name.

c/packet_link.c and c/transport_link.c do what `cosim.network` does, message by message; the steps
of a packet link are translated from it. There is no flavour in Python.
"""

from __future__ import annotations

from typing import Any


class LinkChannel:
    """A link: inputs u[1], u[2], ... and outputs y[1], y[2], ... as it delivers them.

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
