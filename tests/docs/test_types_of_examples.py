"""The programs of the page "In Python" have types that hold."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from docs.page_blocks import ROOT, blocks_of

PAGE = ROOT / "docs" / "how-to" / "in-python.md"


@pytest.mark.slow
def test_the_page_is_strictly_typed(tmp_path: Path) -> None:
    """As one module, in the order of the page."""
    programs = [block.text for block in blocks_of(PAGE) if block.language == "python"]
    assert len(programs) > 10
    (tmp_path / "page.py").write_text("\n\n".join(programs))
    (tmp_path / "mypy.ini").write_text("[mypy]\n")
    command = [sys.executable, "-m", "mypy", "--strict", "page.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603
    assert done.returncode == 0, done.stdout
