#!/usr/bin/env python3
"""Build the FMUs of fmu_src/ into fmus/FLAVOUR/NAME.fmu; two builds give the same bytes.

Native FMUs (FMI 2.0 and 3.0) contain a binary for this machine, made by its C compiler; with
--platforms all they contain one for each of linux and macOS on x86_64 and aarch64 and windows on
x86_64, cross-compiled (pip install 'auv-cosim[cross]'). For other platforms they contain sources.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from cosim.core import CosimError
from cosim.fmu import (
    CATALOGUE,
    FMI_VERSION,
    PLATFORMS,
    Platform,
    channel_source,
    ensure_all,
    platforms_named,
    write_libraries,
    write_manifest,
)
from cosim.master import kernel_source


def package_libraries(out: Path, platforms: Sequence[Platform]) -> list[Path]:
    """Cross-compile the loop's kernel, and the channel to isolated components where it works."""
    written = write_libraries("kernel", kernel_source(), out, platforms)
    for target in platforms:
        if not target.tuple_name.endswith("windows"):
            source = channel_source(futex=target.tuple_name.endswith("linux"))
            written += write_libraries("channel", source, out, [target])
    return written


def main() -> int:
    """Build the FMUs of the command line and print a line for each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(CATALOGUE)}")
    parser.add_argument("--out", type=Path, default=Path("fmus"), help="folder (default: fmus)")
    parser.add_argument(
        "--flavour",
        action="append",
        choices=list(FMI_VERSION),
        help="what to build; may be repeated (default: all)",
    )
    parser.add_argument(
        "--platforms",
        default="host",
        help=f"binaries of native FMUs: host, all, or of {', '.join(PLATFORMS)}, with commas",
    )
    parser.add_argument(
        "--libraries",
        action="store_true",
        help="also cross-compile the libraries of the package, and write the manifest by which "
        "an installed package uses all of them",
    )
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in CATALOGUE]
    if unknown:
        known = ", ".join(CATALOGUE)
        print(f"no component {', '.join(unknown)}\n  expected: {known}", file=sys.stderr)
        return 2
    try:
        platforms = platforms_named(options.platforms)
        if options.libraries and not platforms:
            parser.error("--libraries are cross-compiled: name --platforms")
        for flavour in options.flavour or FMI_VERSION:
            for built in ensure_all(
                options.out, options.names, flavour=flavour, platforms=platforms, force=True
            ):
                digest = hashlib.sha256(built.path.read_bytes()).hexdigest()
                print(f"{digest}  {built.path}", flush=True)
        if options.libraries:
            for library in package_libraries(options.out, platforms):
                print(f"{hashlib.sha256(library.read_bytes()).hexdigest()}  {library}", flush=True)
            write_manifest(options.out, [p.tuple_name for p in platforms])
    except BrokenPipeError:
        # the reader of our output has closed it: keep the interpreter from writing to it at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except CosimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f"the FMU cannot be written: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
