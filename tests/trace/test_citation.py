"""`cosim trace cite`: what it states is in the trace, and BibTeX reads it."""

from __future__ import annotations

import re
from pathlib import Path

from cli.shell import cosim

from cosim.trace import cite, describe

TRACE = Path(__file__).parents[2] / "traces" / "reference" / "auv-acoustic.mcap"


def test_the_paragraph_states_what_the_trace_says(tmp_path: Path) -> None:
    """Software, step, seed, every FMU and link, the certificate, the outcome, the hash."""
    found, run = cite(TRACE), describe(TRACE)
    for words in (
        "auv-cosim 0.1.0 for 8 s at communication steps of 0.05 s, seed 7",
        *(f"SHA-256 {run['run'][f'fmu.{n}.sha256'][:16]}" for n in ("plant", "controller", "sea")),
        "uplink sends a message every 0.15 s, delays it by 0.25 s and uniform jitter",
        "loses it with probability 0.05",
        "at most 3.418674",
        run["outcome"]["headline"],
        run["content_hash"][:16],
    ):
        assert words in found.methods, words
    shown = cosim("trace", "cite", TRACE, cwd=tmp_path, columns=40)
    assert shown.out == f"{found.methods}\n\n{found.bibtex}\n"
    assert cosim("trace", "cite", TRACE, "--json", cwd=tmp_path).json == found.to_json()


def test_the_bibtex_is_well_formed(tmp_path: Path) -> None:
    """Two entries, balanced braces, no bare special character; the whole hash."""
    text = cite(TRACE).bibtex
    assert re.findall(r"^@(\w+)\{([\w-]+),$", text, re.MULTILINE) == [
        ("software", "auv-cosim"),
        ("misc", "auv-cosim-auv-acoustic"),
    ]
    assert text.count("{") == text.count("}")
    assert describe(TRACE)["content_hash"] in text
    odd = tmp_path / "a_b & c.mcap"
    odd.write_bytes(TRACE.read_bytes())
    assert r"MCAP file a\_b \& c.mcap" in cite(odd).bibtex
