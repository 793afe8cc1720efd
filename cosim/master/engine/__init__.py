"""What carries a run out: the same results bit for bit, at different speeds."""

from cosim.master.engine.choice import Engine, EngineChoice, EngineName, build, choose
from cosim.master.engine.program import Adjustment, Halt, Program, make_program
from cosim.master.engine.waiting import fill_in

__all__ = [
    "Adjustment",
    "Engine",
    "EngineChoice",
    "EngineName",
    "Halt",
    "Program",
    "build",
    "choose",
    "fill_in",
    "make_program",
]
