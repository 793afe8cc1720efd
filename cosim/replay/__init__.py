"""A trace back into runs."""

from cosim.replay.inject import Injected, inject
from cosim.replay.mapping import Wanted
from cosim.replay.order import Order
from cosim.replay.rerun import Rerun, rerun

__all__ = ["Injected", "Order", "Rerun", "Wanted", "inject", "rerun"]
