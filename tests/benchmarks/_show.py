"""What a benchmark prints: its table and its JSON, or with --json one JSON object alone."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.table import Table


def show(view: Table, figures: Any, *remarks: str) -> None:
    """Print to stdout."""
    if "--json" in sys.argv:
        print(json.dumps(figures, indent=1))
        return
    console = Console(width=150)
    console.print(view)
    for remark in remarks:
        console.print(remark)
    print(json.dumps(figures))
