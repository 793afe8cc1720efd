#!/usr/bin/env python3
"""Build the FMUs of fmu_src/ into fmus/FLAVOUR/NAME.fmu; two builds give the same bytes.

Native FMUs (FMI 2.0 and 3.0) contain a binary for this machine, made by its C compiler; with
--platforms all they contain one for each of linux and macOS on x86_64 and aarch64 and windows on
x86_64, cross-compiled (pip install 'auv-cosim[cross]'). For other platforms they contain sources.

--prebuilt fills a folder with what the wheel brings, unless it is there already: the native FMUs,
binaries for own components, the libraries of the package, and the manifest by which an installed
package uses them; for all platforms, or for those of --platforms.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

from cosim.core import CosimError
from cosim.fmu.compiled import is_current, library_source, write_library, write_manifest
from cosim.fmu.export import (
    CATALOGUE,
    FMI_VERSION,
    KINDS,
    PLATFORMS,
    Platform,
    ensure_all,
    host,
    platforms_named,
    write_binary,
)

NATIVE = ("native", "native-fmi3")


def build_prebuilt(folder: Path, asked: str | None) -> None:
    """Fill a folder with what the wheel brings, unless it has just that.

    asked : the platforms; None: those that the folder is for, all where there is none.
    """
    targets = (host(),) if asked == "host" else platforms_named(asked or "all")
    names = [target.tuple_name for target in targets]
    if not is_current(folder, None if asked is None else names):
        shutil.rmtree(folder, ignore_errors=True)
        for flavour in NATIVE:
            ensure_all(folder, flavour=flavour, platforms=targets, force=True)

        def build_binary(which: tuple[str, str, Platform]) -> None:
            flavour, kind, target = which
            write_binary(kind, FMI_VERSION[flavour], folder, target)

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(build_binary, product(NATIVE, KINDS, targets)))
        for target in targets:
            write_library("kernel", library_source("kernel"), folder, target)
            if target.suffix != ".dll":
                source = library_source("channel", futex=target.suffix == ".so")
                write_library("channel", source, folder, target)
        write_manifest(folder, names)
    for path in sorted(folder.rglob("*.*")):
        print_digest(path)


def print_digest(path: Path) -> None:
    """Print the SHA-256 of a file and its name."""
    print(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path}", flush=True)


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
        help=f"binaries of native FMUs: host (the default), all, or of {', '.join(PLATFORMS)}, "
        "with commas",
    )
    parser.add_argument("--prebuilt", type=Path, metavar="FOLDER", help="fill this folder instead")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in CATALOGUE]
    if unknown:
        known = ", ".join(CATALOGUE)
        print(f"no component {', '.join(unknown)}\n  expected: {known}", file=sys.stderr)
        return 2
    try:
        if options.prebuilt is not None:
            build_prebuilt(options.prebuilt, options.platforms)
            return 0
        platforms = platforms_named(options.platforms or "host")
        for flavour in options.flavour or FMI_VERSION:
            for built in ensure_all(
                options.out, options.names, flavour=flavour, platforms=platforms, force=True
            ):
                print_digest(built.path)
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
