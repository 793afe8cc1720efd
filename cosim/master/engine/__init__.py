"""Engines that execute the operations of a run: bit-identical results, different speeds."""

from cosim.master.engine.choice import Engine, EngineChoice, EngineName, build_engine, choose_engine
from cosim.master.engine.program import Adjustment, EarlyStop, Program, make_program
from cosim.master.engine.unreceived_inputs import fill_unreceived_inputs

__all__ = [
    "Adjustment",
    "EarlyStop",
    "Engine",
    "EngineChoice",
    "EngineName",
    "Program",
    "build_engine",
    "choose_engine",
    "fill_unreceived_inputs",
    "make_program",
]
