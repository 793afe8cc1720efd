"""Drives a scenario as a session, from Python: another door to the table of hostile FMUs.

    python -m hostile.session SCENARIO TRACE [POINTS]

`POINTS` at a time, by default to the end at once; the rows go into a trace. It prints what its
user is told and ends with the exit code that the command line has for that. A call after a
failure that does not raise it again fails the program.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cosim import open_session
from cosim.core import ComponentError, CosimError
from cosim.master import TraceRecorder
from cosim.scenario import FmuCache, assembled_system, load, prepare
from cosim.trace import TraceWriter

LATER: dict[str, Callable[[Any], Any]] = {
    "step": lambda s: s.step(),
    "run_until": lambda s: s.run(),
    "read": lambda s: s["s.x"],
    "set": lambda s: s.__setitem__("s.x0", 0.1),
    "snapshot": lambda s: s.save(),
}
"""Calls that raise the failure of their session."""


def main(scenario: str, trace: str, points: int = 0) -> int:
    """Drive the session; return the exit code."""
    loaded = load(scenario)
    system, _ = assembled_system(prepare(loaded, FmuCache(Path("fmus"), loaded.folder)))
    status, words = "failed", ""
    code = 0
    with TraceWriter(Path(trace), run={"title": scenario}) as writer:
        try:
            with open_session(scenario, observers=[TraceRecorder(writer, system)]) as session:
                try:
                    while not session.ended:
                        session.step(points) if points else session.run()
                except ComponentError as error:
                    raises_again(session, error)
                    raise
                finally:
                    status, words = session.status or status, session.reason or words
        except CosimError as error:
            words, code = error.text(), error.exit_code
        writer.finish({"status": status, "reason": words})
    print(f"{status}: {words}")
    return code


def raises_again(session: Any, first: ComponentError) -> None:
    """Check that every call of a session that has failed raises what the first one has."""
    assert session.status == "failed"
    for call in LATER.values():
        with pytest.raises(ComponentError) as caught:
            call(session)
        again = caught.value
        assert (again.component, again.call) == (first.component, first.call)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3], *map(int, sys.argv[3:])))
