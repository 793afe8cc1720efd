"""What `mkdocs build` adds to the pages of docs: the generated reference, notebooks, formulas.

Before it builds, it computes the numbers that pages print (`numbers`).

The generated pages exist in the built site alone. `mkdocs.yml` names this file.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
RULES_PAGE = ROOT / "cosim" / "fmu" / "inspect" / "rules.md"
sys.path.insert(0, str(ROOT))  # `mkdocs` does not put the folder of mkdocs.yml there

from docs_site import (  # noqa: E402
    api_pages,
    cli_page,
    notebook_pages,
    numbers,
    toml_pages,
)
from docs_site.formulas import fence  # noqa: E402


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Show ```math fences as MathML, which browsers draw by themselves."""
    fences = [{"name": "math", "class": "math", "format": fence}]
    settings: dict[str, Any] = config.mdx_configs.setdefault("pymdownx.superfences", {})
    settings["custom_fences"] = fences
    return config


def on_pre_build(config: MkDocsConfig) -> None:
    """Compute the numbers that pages print, and build nothing where one differs."""
    del config
    try:
        numbers.require_quick()
    except ValueError as error:
        raise PluginError(str(error)) from error


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are generated from the code."""
    pages = {
        "reference/cli.md": cli_page.page(),
        "reference/fmu-rules.md": RULES_PAGE.read_text("utf-8"),
        **toml_pages.pages(),
        **api_pages.pages(),
    }
    for path in sorted(Path(config.docs_dir).glob("notebooks/*.ipynb")):
        pages[f"notebooks/{path.stem}.md"] = notebook_pages.page(path)
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files
