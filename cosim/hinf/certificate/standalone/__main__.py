"""The program: python -m standalone FILE."""
# mypy: ignore-errors
# ruff: noqa: T201

import sys
from pathlib import Path

from . import RefusedError, check, loaded, not_read

if __name__ == "__main__":
    content = Path(sys.argv[1]).read_bytes()
    try:
        proved = check(content)
    except RefusedError as refused:
        sys.exit(f"not proved: {refused}")
    print("proved:", *(f"  {key}: {value}" for key, value in proved.items()), sep="\n")
    names = ", ".join(not_read(loaded(content)))
    print("not read:", repr(names)[1:-1] or "nothing")  # a name may steer the terminal
