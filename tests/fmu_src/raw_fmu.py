"""An FMU through plain fmpy, with its log: no code of ours between test and binary."""

from __future__ import annotations

import shutil
import tempfile
from contextlib import chdir
from threading import Lock
from typing import TYPE_CHECKING, Any, Self

import fmpy
from fmpy import fmi2, read_model_description

if TYPE_CHECKING:
    from pathlib import Path


_loading = Lock()
"""The working folder is the process's: FMPy enters a library's folder to load it."""


class RawFmu:
    """One instance; use as a context manager.

    `beside` another one of the same FMU it runs on the same loaded library.
    """

    def __init__(self, path: Path, instance: str = "it", beside: RawFmu | None = None) -> None:
        self.model = read_model_description(str(path))
        self.reference = {v.name: v.valueReference for v in self.model.modelVariables}
        self.logged: list[tuple[int, str]] = []
        self._guest = beside is not None
        self._folder = tempfile.mkdtemp() if beside is None else beside._folder
        if beside is None:
            fmpy.extract(str(path), unzipdir=self._folder)
        with _loading, chdir("."):  # FMPy stays in the folder of a library that does not load
            self.fmu = fmi2.FMU2Slave(
                guid=self.model.guid,
                unzipDirectory=self._folder,
                modelIdentifier=self.model.coSimulation.modelIdentifier,
                instanceName=instance,
            )
        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self._callbacks = callbacks  # the binary keeps pointers into it
        self.fmu.instantiate(callbacks=callbacks, loggingOn=True)

    def _log(self, _env: int, _who: bytes, status: int, _category: bytes, text: bytes) -> None:
        self.logged.append((status, text.decode()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.fmu.freeInstance()
        if not self._guest:
            shutil.rmtree(self._folder)

    def put(self, values: dict[str, float]) -> None:
        """Write Reals by name."""
        self.fmu.setReal([self.reference[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Read Reals by name."""
        values: list[float] = self.fmu.getReal([self.reference[name] for name in names])
        return values

    def initialise(self, values: dict[str, float] | None = None, start: float = 0.0) -> Self:
        """Set Reals and pass through initialization mode."""
        self.put(values or {})
        self.fmu.setupExperiment(startTime=start)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def step(self, t: float, h: float) -> None:
        """Advance from t by h [s]."""
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=h)

    def saved(self) -> bytes:
        """Give the whole state as bytes."""
        state = self.fmu.getFMUstate()
        data: bytes = self.fmu.serializeFMUstate(state)
        self.fmu.freeFMUstate(state)
        return data

    def resume(self, data: bytes) -> None:
        """Take over a state from `saved`."""
        state = self.fmu.deSerializeFMUstate(data)
        self.fmu.setFMUstate(state)
        self.fmu.freeFMUstate(state)

    @property
    def messages(self) -> str:
        """Everything logged, one per line."""
        return "\n".join(text for _, text in self.logged)

    @staticmethod
    def tag(path: Path) -> str:
        """Give the part of the GUID that names the modules of an FMU."""
        return str(read_model_description(str(path)).guid).replace("-", "").strip("{}")[:12]

    def outputs(self) -> list[str]:
        """Names of the Real outputs."""
        return [v.name for v in self.model.modelVariables if v.causality == "output"]


def matrices(**changed: Any) -> dict[str, float]:
    """Parameters of the section 5 DelayedPlant from matrices by letter."""
    return {
        f"{letter}[{i},{j}]": float(value)
        for letter, rows in changed.items()
        for i, row in enumerate(rows, 1)
        for j, value in enumerate(row, 1)
    }
