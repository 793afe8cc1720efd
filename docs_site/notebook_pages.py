"""Notebooks as pages: text as it is, cells as blocks of Python."""

from __future__ import annotations

import json
from pathlib import Path


def page(path: Path) -> str:
    """Return a notebook in Markdown, with a link to its file."""
    cells = json.loads(path.read_text("utf-8"))["cells"]
    parts = []
    for cell in cells:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    title, _, rest = parts[0].partition("\n")
    link = f"[Download the notebook]({path.name})"
    return "\n\n".join([title, link, rest.strip(), *parts[1:]]) + "\n"
