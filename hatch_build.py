"""Put prebuilt FMUs and libraries into the wheel: hatchling calls this, and it calls build_fmu.py.

AUV_COSIM_PREBUILT=none in the environment makes a wheel without them, which compiles on the user's
machine; a folder there is filled, or used as it is where it was filled from the same sources, for
whichever platforms (build_fmu.py --prebuilt). An editable installation has none.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

VARIABLE = "AUV_COSIM_PREBUILT"
REQUIREMENTS = [
    "latex2mathml>=3.77",
    "lazy-loader>=0.4",
    "markdown-it-py>=3.0",
    "numpy>=2.0",
    "platformdirs>=4.2",
    "ziglang==0.17.1",
]
"""What build_fmu.py needs; the bytes of the FMUs in the wheel are those of this zig."""


class PrebuiltHook(BuildHookInterface[Any]):
    """Adds the folder `cosim/prebuilt` to a wheel."""

    def dependencies(self) -> list[str]:
        """Return what is installed for the build: nothing where nothing is compiled."""
        # pip and build name on their command line what they ask for
        editable = "get_requires_for_build_editable" in sys.argv
        return [] if editable or os.environ.get(VARIABLE) == "none" else REQUIREMENTS

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the folder, or take the one that the environment names.

        Raises
        ------
        RuntimeError : it cannot be built, for example without ziglang.
        """
        if version == "editable":
            return
        chosen = os.environ.get(VARIABLE, "")
        if chosen == "none":
            self.app.display_warning(
                f"{VARIABLE}=none: this wheel has no prebuilt binaries; where it is installed, "
                "native FMUs and the kernel need a C compiler"
            )
            return
        folder = Path(chosen or tempfile.mkdtemp(prefix="auv-cosim-prebuilt-")).absolute()
        self._build(folder)
        build_data["force_include"][str(folder)] = "cosim/prebuilt"

    def _build(self, folder: Path) -> None:
        root = Path(self.root)
        inherited = filter(None, [os.environ.get("PYTHONPATH")])
        done = subprocess.run(  # noqa: S603 - our own script
            [sys.executable, "build_fmu.py", "--prebuilt", str(folder)],
            cwd=root,
            # an isolated build finds its requirements by PYTHONPATH
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(root), *inherited])},
            check=False,
            capture_output=True,
            text=True,
        )
        if done.returncode != 0:
            raise RuntimeError(
                f"the FMUs of the wheel cannot be built: {done.stderr.strip()}\n"
                f"  or build a wheel that compiles where it is installed: {VARIABLE}=none"
            )
