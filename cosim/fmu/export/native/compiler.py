"""Compile C to a shared library, with the system's compiler or with zig for other platforms.

The same sources and compiler give the same bytes: no build identity, path or time gets in.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from cosim.core import InputError, still_working
from cosim.fmu.compiled.prebuilt import why_none_prebuilt
from cosim.fmu.export.native.target_platforms import Platform, has_cross_compiler
from cosim.fmu.unpacking import own_folder

STANDARD = ("-std=c99", "-O3", "-ffp-contract=off", "-fvisibility=hidden")


def host_compiler() -> list[str]:
    """Return the command of the system's C compiler: $CC, or the first of cc, gcc, clang.

    Raises
    ------
    InputError : there is none.
    """
    chosen = os.environ.get("CC", "").strip()
    for command in [chosen] if chosen else ["cc", "gcc", "clang"]:
        words = shlex.split(command)
        if words and shutil.which(words[0]):
            return words
    raise InputError(
        "native FMUs need a C compiler",
        expected="cc, gcc or clang on the PATH, or the one named by CC",
        got="; ".join(
            filter(None, [f"CC={chosen}" if chosen else "none of them", why_none_prebuilt()])
        ),
        hint="install one (Debian: apt install gcc), or the extra that brings a cross compiler, "
        "pip install 'auv-cosim[cross]', and build for all `platforms`; the `flavour` python "
        "needs none",
    )


def cross_compiler() -> list[str]:
    """Return the command of zig's C compiler, from the extra `cross`.

    Raises
    ------
    InputError : the extra is not installed.
    """
    if not has_cross_compiler():
        why = why_none_prebuilt()
        ready = "install the wheel: its FMUs have binaries for all platforms"
        if why is None:
            ready = "--platforms prebuilt, which has binaries for all platforms"
        raise InputError(
            "FMUs for other platforms need a cross compiler",
            expected="the package ziglang",
            got="no such package" + (f"; and {why}" if why else ""),
            hint=f"pip install 'auv-cosim[cross]', or {ready}",
        )
    return [sys.executable, "-m", "ziglang", "cc"]


def shared_library(
    name: str,
    sources: Mapping[str, bytes],
    compiled: Sequence[str],
    target: Platform,
    *,
    cross: bool,
) -> bytes:
    """Compile and link the library of a model and return its bytes.

    Parameters
    ----------
    sources : file name -> content; headers included.
    compiled : the files to compile.
    cross : by zig for `target`; otherwise by the system's compiler, for this machine.

    Raises
    ------
    InputError : no compiler, or it rejects the sources.
    """
    command = [*cross_compiler(), "-target", target.zig] if cross else host_compiler()
    command += STANDARD
    if target.suffix != ".dll":
        command += ["-fPIC", "-DOLDEST_LIBM"]
    command += ["-shared", *_link_options(name, target, cross=cross)]
    with tempfile.TemporaryDirectory(prefix="native-", dir=own_folder()) as folder:
        for file, content in sources.items():
            Path(folder, file).write_bytes(content)
        library = f"{name}{target.suffix}"
        command += ["-I.", *compiled, "-o", library]
        if target.suffix != ".dll":
            command.append("-lm")
        still_working()
        done = subprocess.run(  # noqa: S603 - a compiler, on our own sources
            command,
            cwd=folder,
            check=False,
            capture_output=True,
            text=True,
            env={**os.environ, "LC_ALL": "C", "SOURCE_DATE_EPOCH": "315532800"},
        )
        built = Path(folder, library)
        if done.returncode != 0 or not built.is_file():
            raise InputError(
                f"the C of the FMU cannot be compiled for {target.tuple_name}",
                expected="a C99 compiler",
                got=f"{shlex.join(command[:4])} ...: {done.stderr.strip()[-2000:]}",
            )
        return built.read_bytes()


def _link_options(name: str, target: Platform, *, cross: bool) -> list[str]:
    if target.suffix == ".so":
        return ["-s", "-Wl,--build-id=none"]
    if target.suffix == ".dylib":
        return [f"-Wl,-install_name,@rpath/{name}.dylib", *(["-s"] if cross else [])]
    return ["-s", *([] if cross else ["-Wl,--no-insert-timestamp"])]
