"""Runs of designs that claim another thing than is proved of them.

No proof holds such a claim, which a run says; what the claim asks of the run is looked at all the
same, word by word and to the nanosecond.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from cosim.hinf import Result
from cosim.hinf.certificate import system_from_json
from cosim.scenario import FmuCache, LoadedScenario, PreparedScenario, execute_unrecorded, prepare


def claiming(design: Result, at: int = -1, **changed: Any) -> Result:
    """A design of a state feedback, with another claim about one of its delays."""
    data = json.loads(json.dumps(design.certificate))
    data["claim"]["delays"][at] |= {k: x for k, x in changed.items() if k != "sampled"}
    data["system"]["delays"][at] |= {k: x for k, x in changed.items() if k != "age"}
    return replace(design, system=system_from_json(data["system"]), certificate=data)


def with_claim(design: Result, **changed: Any) -> Result:
    """A design whose claim has other keys."""
    data = json.loads(json.dumps(design.certificate))
    data["claim"] |= changed
    return replace(design, certificate=data)


class Claims:
    """A scenario that is run with one claim of its design after the other."""

    def __init__(self, loaded: LoadedScenario, native_fmus: Path) -> None:
        self._cache = FmuCache(native_fmus.parent, loaded.folder, flavour="native")
        self.prepared: PreparedScenario = prepare(loaded, self._cache)

    @property
    def design(self) -> Result:
        """The design that is proved."""
        assert self.prepared.design is not None
        return self.prepared.design

    def metrics(self, claimed: Result) -> dict[str, Any]:
        """What a run says of a claim; a zero-state run says no more of it."""
        problem = self.prepared.problem
        assert problem is not None
        saved = replace(problem, system=claimed.system), claimed
        prepared = prepare(self.prepared.loaded, self._cache, saved=saved)
        return dict(execute_unrecorded(prepared, zero_state_run=False)[0].metrics)

    def unmet(self, claimed: Result) -> set[str]:
        """The assumptions of a claim that a run does not meet."""
        met = self.metrics(claimed)["assumptions"]
        return {name for name, is_met in met.items() if not is_met} - {"certificate_verified"}
