"""Run logs as earlier releases wrote them: rows without checksums, which a test may change."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from study.deadly import MANIFEST, RESULTS, RUN_LOG, base, planned

from cosim.core import LossError
from cosim.study import Study, execute_study, read_table

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


def table_of(study: Study, rows: list[Cells], folder: Path) -> tuple[Any, dict[str, Any]]:
    """The table, and its manifest, of a study of the usual scenario that has these rows."""
    with contextlib.suppress(LossError):  # its time is over when it has begun
        execute_study(planned(study, base()), folder, time_limit_s=0.0)
    (folder / RESULTS).unlink(missing_ok=True)
    write_bare(folder, lambda _: rows)
    return read_table(folder)
