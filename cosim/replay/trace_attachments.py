"""What a trace carries of the run it is of: scenario, gain, worst case."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from cosim.core import InputError
from cosim.hinf import WorstCase, certificate_from_bytes, worst_case_from_json
from cosim.scenario import LoadedScenario, parse
from cosim.trace import DESIGN_ATTACHMENT, SCENARIO_ATTACHMENT, Trace


def attachment(trace: Trace, name: str, digest: str) -> bytes:
    """An attachment, which must be the one whose hash the trace names under `digest`.

    Raises
    ------
    InputError : there is none, or it is another one.
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
            f"{name} in this trace is not the one it was run with",
            where=str(trace.path),
            expected=f"SHA-256 {recorded}",
            got=found,
        )
    return data


def scenario_in(trace: Trace, folder: Path) -> LoadedScenario:
    """The scenario of a trace; `folder`: where its relative paths begin.

    Raises
    ------
    InputError : there is none, or it is no scenario.
    """
    text = attachment(trace, SCENARIO_ATTACHMENT, "scenario.sha256")
    name = trace.run.get("scenario", trace.path.stem)
    where = f"{trace.path}: {SCENARIO_ATTACHMENT}"
    return parse(text.decode(), name=name, where=where, folder=folder)


def design_in(trace: Trace) -> Any:
    """The design of a trace as JSON values, its proof not checked.

    Raises
    ------
    InputError : there is none.
    """
    return json.loads(attachment(trace, DESIGN_ATTACHMENT, "design.sha256"))


def worst_case_in(trace: Trace, size: int) -> WorstCase | None:
    """The worst case that flew, also where an older version gave it more digits; None if none did.

    size : number of entries of w.

    Raises
    ------
    InputError : what is recorded is none.
    """
    recorded = trace.run.get("disturbance")
    if recorded is None:
        return None
    where = f"{trace.path}: disturbance"
    data = certificate_from_bytes(recorded.encode(), where)
    return worst_case_from_json(data, where, size)
