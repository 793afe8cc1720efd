"""Check that a built site loads nothing from elsewhere: `python -m docs_site.offline site`.

A link that a reader may follow is no address that is loaded.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

_LOADED = re.compile(
    r"""(?:\s(?:src|srcset)=["']?|<link\s[^>]*href=["']?|url\(["']?|@import\s+["'])"""
    r"((?:https?:)?//[^\"'\s)>]+)"
)
_NAMESPACE = "www.w3.org"


def loaded_from_elsewhere(site: Path) -> Iterator[str]:
    """Give each address beyond the site that a page or a style sheet loads, with its file."""
    for path in sorted(site.rglob("*")):
        if path.suffix in (".html", ".css", ".svg"):
            for found in _LOADED.findall(path.read_text("utf-8")):
                if _NAMESPACE not in found:
                    yield f"{path.relative_to(site)}: {found}"


def main() -> int:
    """Print what is found; 1 if anything is."""
    site = Path(sys.argv[1])
    found = list(loaded_from_elsewhere(site))
    pages = sum(1 for _ in site.rglob("*.html"))
    print(*found, f"{pages} pages, {len(found)} addresses beyond the site", sep="\n")
    return 1 if found or not pages else 0


if __name__ == "__main__":
    sys.exit(main())
