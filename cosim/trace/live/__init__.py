"""Show traces in other tools: play them to Foxglove, open them in Rerun."""

from cosim.trace.live.player import Player
from cosim.trace.live.rerun_view import ViewResult, view_in_rerun

__all__ = ["Player", "ViewResult", "view_in_rerun"]
