"""A trace back into runs."""

from cosim.replay.rerun import Rerun, rerun

__all__ = ["Rerun", "rerun"]
