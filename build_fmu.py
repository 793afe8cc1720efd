#!/usr/bin/env python3
"""Build the FMUs of fmu_src/ into fmus/python/NAME.fmu; two builds give the same bytes."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from pathlib import Path

from fmu_src.build import ensure_all
from fmu_src.catalogue import CATALOGUE


def main() -> int:
    """Parse the command line, build, print a line per FMU."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(CATALOGUE)}")
    parser.add_argument("--out", type=Path, default=Path("fmus"), help="folder (default: fmus)")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in CATALOGUE]
    if unknown:
        known = ", ".join(CATALOGUE)
        print(f"no component {', '.join(unknown)}\n  expected: {known}", file=sys.stderr)
        return 2
    try:
        for built in ensure_all(options.out, options.names, force=True):
            digest = hashlib.sha256(built.path.read_bytes()).hexdigest()
            print(f"{digest}  {built.path}")
    except BrokenPipeError:
        # the reader of our output is gone: nothing is left to say it to
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        print(f"the FMU cannot be written: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
