"""Channels: delay, jitter, loss, order, hold."""

from cosim.network.packet import GilbertElliott, Jitter, PacketLink
from cosim.network.schedule import (
    DELIVERED,
    IN_FLIGHT,
    LOST,
    NONE_YET,
    OVERTAKEN,
    REASONS,
    SUBSTITUTE,
    Alignment,
    PacketSchedule,
    align,
    schedule,
)
from cosim.network.transport import TransportLink

__all__ = [
    "DELIVERED",
    "IN_FLIGHT",
    "LOST",
    "NONE_YET",
    "OVERTAKEN",
    "REASONS",
    "SUBSTITUTE",
    "Alignment",
    "GilbertElliott",
    "Jitter",
    "PacketLink",
    "PacketSchedule",
    "TransportLink",
    "align",
    "schedule",
]
