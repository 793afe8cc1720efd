"""A system that is wired in memory which parent and child share."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.master.supervision.shared import SharedRun, reserve
from cosim.master.system import System
from cosim.master.wire import wire
from cosim.master.wiring import RowMemory, Wiring


@dataclass(frozen=True, eq=False)
class Wired:
    """A wiring whose rows lie in shared memory.

    Attributes
    ----------
    wiring : of the run.
    shared, descriptor, size : the memory, as `reserve` returns it.
    """

    wiring: Wiring
    shared: SharedRun
    descriptor: int
    size: int

    @classmethod
    def of(cls, system: System) -> Wired:
        """Wire a system.

        Raises
        ------
        InputError : see `wire` and `reserve`.
        """
        made: list[tuple[SharedRun, int, int]] = []

        def memory(shape: tuple[int, int]) -> RowMemory:
            if not made:
                made.append(reserve(shape))
            return made[0][0].rows(shape)

        return cls(wire(system, memory), *made[0])
