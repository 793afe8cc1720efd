"""The slave of a behaviour that reports more than a status, such as the change of a watchdog."""

from __future__ import annotations

from pythonfmu.enums import Fmi2Status

from cosim.fmu.export.python.slave import BehaviourSlave


class WatchedSlave(BehaviourSlave):
    """Logs what `notice` of its behaviour gives after a step, as a warning."""

    def _do_step(self, current_time: float, step_size: float) -> bool:
        done = super()._do_step(current_time, step_size)
        notice = self._behaviour.notice()
        if notice is not None:
            self.log(notice, Fmi2Status.warning, "logStatusWarning")
        return done
