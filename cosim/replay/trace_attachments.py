"""Read scenario, design and worst case of a run from its trace."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from cosim.core import InputError
from cosim.hinf.certificate import certificate_from_bytes
from cosim.hinf.delay_lti import WorstCase, worst_case_from_json
from cosim.scenario import LoadedScenario, parse
from cosim.trace import Trace
from cosim.trace.rows import DESIGN_ATTACHMENT, SCENARIO_ATTACHMENT


def attachment(trace: Trace, name: str, digest: str) -> bytes:
    """Return an attachment and check it against the hash that the trace names under `digest`.

    Raises
    ------
    InputError : missing, or its hash differs.
    """
    data = trace.attachments.get(name)
    if data is None:
        raise InputError(
            "this trace cannot be run again",
            where=str(trace.path),
            expected=f"an attachment {name}, as cosim run writes it",
            got=", ".join(trace.attachments) or "no attachments",
        )
    recorded, found = trace.run.get(digest), hashlib.sha256(data).hexdigest()
    if recorded != found:
        raise InputError(
            f"{name} in this trace is not that of its run",
            where=str(trace.path),
            expected=f"SHA-256 {recorded}",
            got=found,
        )
    return data


def scenario_in(trace: Trace, folder: Path) -> LoadedScenario:
    """Read the scenario of a trace; `folder` : start of relative paths.

    Raises
    ------
    InputError : missing, or not a scenario.
    """
    text = attachment(trace, SCENARIO_ATTACHMENT, "scenario.sha256")
    name = trace.run.get("scenario", trace.path.stem)
    where = f"{trace.path}: {SCENARIO_ATTACHMENT}"
    return parse(text.decode(), name=name, where=where, folder=folder)


def design_in(trace: Trace) -> Any:
    """Read the design of a trace as JSON values, without checking its proof; see `attachment`."""
    return json.loads(attachment(trace, DESIGN_ATTACHMENT, "design.sha256"))


def worst_case_in(trace: Trace, size: int) -> WorstCase | None:
    """Read the worst-case disturbance of the run, with all digits of older versions; or None.

    size : number of entries of w.

    Raises
    ------
    InputError : the recorded value is not a worst case.
    """
    recorded = trace.run.get("disturbance")
    if recorded is None:
        return None
    where = f"{trace.path}: disturbance"
    data = certificate_from_bytes(recorded.encode(), where)
    return worst_case_from_json(data, where, size)
