"""Traces shown to people by other tools: played to Foxglove, opened in Rerun."""

from cosim.trace.live.player import Player
from cosim.trace.live.rerun_view import ViewResult, view_in_rerun

__all__ = ["Player", "ViewResult", "view_in_rerun"]
