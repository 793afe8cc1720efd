"""Channels: delay, jitter, loss, copies, order, hold."""

from cosim.network.alignment import Alignment, align
from cosim.network.checks import MAX_NS
from cosim.network.delay_signal import DelaySignal
from cosim.network.impairment import GilbertElliott, Jitter, LossWindow
from cosim.network.live import LiveSchedule
from cosim.network.messages import sending_instants
from cosim.network.packet import PacketLink
from cosim.network.profile import DelayProfile
from cosim.network.resolve import schedule
from cosim.network.schedule import (
    DELIVERED,
    DUPLICATE,
    IN_FLIGHT,
    LOST,
    OVERTAKEN,
    QUEUE_FULL,
    REASONS,
    Arrivals,
    PacketSchedule,
)
from cosim.network.state import NONE_YET, SUBSTITUTE, LinkState
from cosim.network.transport import TransportLink

__all__ = [
    "DELIVERED",
    "DUPLICATE",
    "IN_FLIGHT",
    "LOST",
    "MAX_NS",
    "NONE_YET",
    "OVERTAKEN",
    "QUEUE_FULL",
    "REASONS",
    "SUBSTITUTE",
    "Alignment",
    "Arrivals",
    "DelayProfile",
    "DelaySignal",
    "GilbertElliott",
    "Jitter",
    "LinkState",
    "LiveSchedule",
    "LossWindow",
    "PacketLink",
    "PacketSchedule",
    "TransportLink",
    "align",
    "schedule",
    "sending_instants",
]
