"""Run logs as earlier releases wrote them: rows without checksums, which a test may change."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from study.deadly import MANIFEST, RUN_LOG

Cells = list[Any]
"""Number, status, reason and seconds of a run, then its metrics."""


def write_bare(folder: Path, change: Callable[[list[Cells]], list[Cells]]) -> None:
    """Write the run log of a study again, without checksums: what `change` makes of its rows."""
    log, file = folder / RUN_LOG, folder / MANIFEST
    rows = [json.loads(line)["row"] for line in log.read_text("utf-8").splitlines()]
    log.write_text("".join(f"{json.dumps(row)}\n" for row in change(rows)), "utf-8")
    manifest = json.loads(file.read_text("utf-8"))
    del manifest["run_log_checked"]
    file.write_text(json.dumps(manifest), "utf-8")
