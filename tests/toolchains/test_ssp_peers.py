"""Exported archives in foreign tools, compared with our own master.

What OMSimulator asks of an archive could not be run here; its own examples and documentation
say: prefixes free, connectors for what is connected, and an annotation org.openmodelica with the
fixed step of its master, which the archives have.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from ssp.archives import Links
from toolchains.peer_run import skip_without
from toolchains.ssp_peer_run import PEERS, Archive, Peer, label, run_peer

from cosim.master import simulate
from cosim.scenario import FmuCache, assembled_system, export_ssp, parse, prepare

TOLERANCE = 1e-9

FROM_REST = """
title = "Section 5 from rest"
[run]
end = 2.0
step = 0.01
seed = 5
events = "grid"
[components.plant]
fmu = "DelayedPlant"
[components.plant.parameters]
"initial.x[1]" = 0.0
"initial.x[2]" = 0.0
"delay.d" = 0.21
[components.controller]
fmu = "PaperController"
[components.exosystem]
fmu = "WaveField"
[components.exosystem.parameters]
spectrum = 0
"omega[1]" = 4.0
"amplitude[1]" = 1.0
"gain.v" = 0.0
"gain.w" = 0.0
"gain.r" = 0.0
[[connections]]
from = "exosystem.disturbance.u"
to = "plant.w[1]"
"""

LOOP = """
[[connections]]
from = "plant.x"
to = "controller.x"
{up}
[[connections]]
from = "controller.u"
to = "plant.u"
{down}
"""

LINKS = """
[links.uplink]
kind = "packet"
sample_time = 0.03
delay = 0.025
jitter = { kind = "normal", mean = 0.02, sigma = 0.02 }
loss = { p_enter = 0.1, p_exit = 0.4 }
order = "as-arrived"
quantization = 1e-3
[links.downlink]
kind = "transport"
delay = 0.034
"""

DEFAULTS = """
title = "Section 5 with nothing set"
[run]
end = 2.0
step = 0.01
events = "grid"
[components.plant]
fmu = "DelayedPlant"
[components.controller]
fmu = "PaperController"
"""


def scenario(name: str, *, linked: bool) -> str:
    loop = LOOP.format(up='link = "uplink"' * linked, down='link = "downlink"' * linked)
    return {"from rest": FROM_REST, "defaults": DEFAULTS}[name] + loop + LINKS * linked


def exported(
    text: str, links: Links, fmus: Path, folder: Path
) -> tuple[Archive, dict[str, NDArray[np.float64]]]:
    """Export the archive, and run the scenario by our own master."""
    loaded = parse(text, name="peer", where="peer.toml", folder=folder)
    prepared = prepare(loaded, FmuCache(fmus.parent, folder, flavour="native"))
    ssp = folder / "peer.ssp"
    export_ssp(prepared, ssp, links)
    run = simulate(assembled_system(prepared)[0])
    assert run.status == "finished"
    watch = (("plant", "x[1]"), ("plant", "x[2]"), ("controller", "u[1]"))
    archive = Archive(str(ssp), 10_000_000, run.points_ns.size - 1, watch)
    return archive, {label(*w): run.signal(*w)[1:] for w in watch}


def assert_equal(
    found: dict[str, NDArray[np.float64]], expected: dict[str, NDArray[np.float64]]
) -> None:
    assert any(np.abs(row).max() > 1e-3 for row in expected.values())
    for name, row in expected.items():
        scale = max(1.0, float(np.abs(row).max()))
        most = float(np.abs(found[name] - row).max())
        found_wrong = f"{name} differs by {most:.2g}, and is {scale:.3g} at most"
        assert most <= TOLERANCE * scale, found_wrong


@pytest.mark.parametrize("links", ["no links", "link FMUs"])
@pytest.mark.parametrize("peer", PEERS.values(), ids=PEERS)
def test_archive_runs_elsewhere_as_here(
    native_fmus: Path, tmp_path: Path, peer: Peer, links: str
) -> None:
    """Without links, and with links that lose, delay and quantize as FMUs."""
    skip_without(peer.modules)
    linked = links == "link FMUs"
    text = scenario("from rest" if peer.bound else "defaults", linked=linked)
    archive, ours = exported(text, "fmu", native_fmus, tmp_path)
    assert_equal(run_peer(peer, archive, tmp_path), ours)


@pytest.mark.parametrize("peer", [PEERS["ecos"], PEERS["libcosim"]], ids=["ecos", "libcosim"])
def test_vehicle_over_its_acoustic_links_runs_elsewhere_as_here(
    native_fmus: Path, tmp_path: Path, peer: Peer
) -> None:
    """A designed gain, a sea, a path to follow, and two lossy links with jitter."""
    skip_without(peer.modules)
    from cosim.scenario import load  # noqa: PLC0415

    text = load("auv-acoustic").text.replace("end = 180.0", "end = 60.0")
    text = text.replace('events = "align"', 'events = "grid"')
    loaded = parse(text, name="vehicle", where="vehicle.toml", folder=tmp_path)
    prepared = prepare(loaded, FmuCache(native_fmus.parent, tmp_path, flavour="native"))
    export_ssp(prepared, tmp_path / "vehicle.ssp", "fmu")
    run = simulate(assembled_system(prepared)[0])
    watch = tuple(("plant", f"eta.{axis}") for axis in ("x", "y", "z", "psi"))
    watch += (("controller", "force.x"), ("controller", "moment.z"))
    archive = Archive(str(tmp_path / "vehicle.ssp"), 50_000_000, run.points_ns.size - 1, watch)
    assert_equal(run_peer(peer, archive, tmp_path), {label(*w): run.signal(*w)[1:] for w in watch})


def test_other_tools_run_annotated_links_as_direct_connections(
    native_fmus: Path, tmp_path: Path
) -> None:
    """As the warning of the export says: the archive runs as if there were no links."""
    skip_without(PEERS["ecos"].modules)
    archive, linked = exported(
        scenario("from rest", linked=True), "annotate", native_fmus, tmp_path
    )
    (tmp_path / "plain").mkdir()
    _, plain = exported(scenario("from rest", linked=False), "fmu", native_fmus, tmp_path / "plain")
    found = run_peer(PEERS["ecos"], archive, tmp_path)
    assert_equal(found, plain)
    with pytest.raises(AssertionError):
        assert_equal(found, linked)
