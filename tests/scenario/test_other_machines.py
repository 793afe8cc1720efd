"""Content of a run on other processors, emulated by environment variables in own processes.

`OPENBLAS_CORETYPE` makes the BLAS choose the kernels of another processor,
`NPY_DISABLE_CPU_FEATURES` makes NumPy leave out instructions that it has loops for. Neither may
reach a content hash. `GLIBC_TUNABLES` takes fused multiply-add from the C library, whose sine then
rounds otherwise: that is another kind of machine.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from cli.shell import cosim
from shared import share_of

from cosim.scenario import builtin_names

# of NumPy up to 2.3, and of later ones
_AVX512 = (
    "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR "
    "AVX512_KNL AVX512_KNM X86_V4"
)
MACHINES = {
    "as it is": {},
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "Sandybridge": {"OPENBLAS_CORETYPE": "Sandybridge"},
    "Nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "Prescott": {"OPENBLAS_CORETYPE": "Prescott"},
    "no AVX512": {"NPY_DISABLE_CPU_FEATURES": _AVX512},
    "no AVX2": {"NPY_DISABLE_CPU_FEATURES": f"{_AVX512} AVX2 FMA3 X86_V3"},
    "Sandybridge, no AVX2": {
        "OPENBLAS_CORETYPE": "Sandybridge",
        "NPY_DISABLE_CPU_FEATURES": f"{_AVX512} AVX2 FMA3 X86_V3",
    },
}
NO_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"}
_QUARTERS = share_of(range(4))
SCENARIOS = [name for i, name in enumerate(builtin_names()) if i % 4 in _QUARTERS]
"""Every built-in scenario, or a share of them."""
RUN_SCRIPT = """\
import json, sys
from pathlib import Path
from cosim.scenario.python_api import run

fmus, folder, names = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]
print(json.dumps({
    name: run(name, folder / f"{name}.mcap", fmus=fmus, flavour="native").content_hash
    for name in names
}))
"""


def content_hashes(
    names: list[str], fmus: Path, folder: Path, machine: dict[str, str]
) -> dict[str, str]:
    """Content hash by scenario, run into `folder` by a process with this environment."""
    own = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "GLIBC_TUNABLES")
    environment = {key: value for key, value in os.environ.items() if key not in own}
    done = subprocess.run(  # noqa: S603 - this interpreter, with arguments from here
        [sys.executable, "-c", RUN_SCRIPT, fmus.parent, folder, *names],
        env=environment | machine,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, str] = json.loads(done.stdout)
    return found


def test_no_blas_and_no_vector_loop_changes_a_content_hash(
    native_fmus: Path, tmp_path: Path
) -> None:
    """Worst cases, path, sea and lossy links: the same content on an older processor."""
    names = ["auv-acoustic", "auv-worst-case", "paper-worst-case"]
    hashes = [
        content_hashes(names, native_fmus, tmp_path / name, MACHINES[name])
        for name in ("as it is", "Sandybridge, no AVX2")
    ]
    assert hashes[0] == hashes[1]


@pytest.fixture(scope="module")
def here(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Content hash of each scenario on this machine as it is."""
    return content_hashes(SCENARIOS, native_fmus, tmp_path_factory.mktemp("here"), {})


@pytest.mark.slow
@pytest.mark.parametrize("name", share_of(name for name in MACHINES if MACHINES[name]))
def test_every_built_in_scenario_has_one_content_hash(
    name: str, here: dict[str, str], native_fmus: Path, tmp_path: Path
) -> None:
    """All of them, under every processor that can be emulated."""
    assert content_hashes(SCENARIOS, native_fmus, tmp_path, MACHINES[name]) == here


@pytest.mark.slow
@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc",
    reason="GLIBC_TUNABLES chooses among the sines of the GNU C library; others have one",
)
@pytest.mark.parametrize(
    "names",
    [
        ["auv-acoustic", "paper-worst-case"],
        pytest.param(SCENARIOS, marks=pytest.mark.slow, id="all"),
    ],
)
def test_without_fused_multiply_add_only_rounding_differs(
    names: list[str], native_fmus: Path, tmp_path: Path
) -> None:
    """Another kind of machine: the hash may be another, the numbers agree to the tolerance."""
    here = content_hashes(names, native_fmus, tmp_path / "here", {})
    there = content_hashes(names, native_fmus, tmp_path / "there", NO_FMA)
    for name in names:
        traces = [tmp_path / folder / f"{name}.mcap" for folder in ("here", "there")]
        found = cosim(
            "trace", "diff", *traces, "--abs", "1e-6", "--rel", "1e-9", "--json", cwd=tmp_path
        )
        assert found.code == 0, (name, found.out)
        if here[name] == there[name]:
            assert cosim("trace", "diff", *traces, cwd=tmp_path).code == 0
