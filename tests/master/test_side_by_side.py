"""Components that step side by side on threads: the same rows and log lines, bit for bit."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest
from mixed import mixed_fmu
from scalar import scalar_fmu
from test_kernel_agrees import run_random

from cosim.core import InputError
from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import Component, System, make_schedule, simulate


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> tuple[FmuDescription, FmuDescription]:
    folder = tmp_path_factory.mktemp("fmus")
    return describe_fmu(scalar_fmu(folder)), describe_fmu(mixed_fmu(folder))


def test_threads_change_nothing(fmus: tuple[FmuDescription, FmuDescription]) -> None:
    before = threading.active_count()
    compared = 0
    for seed in range(120):
        alone = run_random(seed, fmus, "kernel")
        several = run_random(seed, fmus, "kernel", threads=3)
        if isinstance(several, str) and "gauss-seidel" in several:
            continue
        compared += 1
        assert several == alone, f"seed {seed}"
    assert compared > 60
    assert threading.active_count() == before


def test_threads_are_refused_where_they_cannot_be(
    fmus: tuple[FmuDescription, FmuDescription],
) -> None:
    system = scalars_of(fmus[0])
    with pytest.raises(InputError, match="side by side in the kernel only"):
        simulate(replace(system, threads=2), engine="python")
    with pytest.raises(InputError, match="under gauss-seidel"):
        replace(system, threads=2, algorithm="gauss-seidel")
    with pytest.raises(InputError, match="1 or more"):
        replace(system, threads=0)


def scalars_of(fmu: FmuDescription) -> System:
    """Two scalars, not connected."""
    components = {name: Component(fmu) for name in ("a", "b")}
    return System(components, [], {}, {}, make_schedule({}, 10**8, 10**9, "grid"))
