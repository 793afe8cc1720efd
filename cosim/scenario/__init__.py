"""Scripted scenarios: read, assemble, fly, judge; from Python: `run_scenario`, `open_session`."""

from cosim.scenario.opening import open_session, run_scenario
from cosim.scenario.outcome import Outcome
from cosim.scenario.schema import Scenario

__all__ = ["Outcome", "Scenario", "open_session", "run_scenario"]
