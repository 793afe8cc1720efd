"""A paragraph for the methods section of a paper, and BibTeX, from what a trace says of its run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from cosim.core import AnyPath, at_most, counted
from cosim.trace.info import describe
from cosim.trace.rows.layout import parsed_json

_SHORT = 16
"""Digits of a hash in a sentence; the BibTeX has it whole."""
_SPECIAL = str.maketrans({c: f"\\{c}" for c in "&%$#_{}"})


class Citation(NamedTuple):
    """How a run is cited.

    Attributes
    ----------
    methods : a paragraph for a methods section.
    bibtex : entries of the software and of the run.
    """

    methods: str
    bibtex: str

    def to_json(self) -> dict[str, str]:
        """Return both texts by their names."""
        return self._asdict()


def cite(path: AnyPath) -> Citation:
    """Return the citation of the run in a trace; nothing is stated that the trace does not say.

    Raises
    ------
    InputError, LossError : as `Trace`.
    """
    found = describe(path)
    run = found["run"]
    sentences = [
        _run(run),
        _components(run),
        *(_link(name[5:], parsed_json(e)) for name, e in run.items() if name.startswith("link.")),
        _certificate(found["certificate"]),
        _outcome(found["outcome"]),
        _trace(found, Path(path)),
    ]
    return Citation(" ".join(filter(None, sentences)), _bibtex(found, Path(path)))


def _run(run: Mapping[str, Any]) -> str:
    software, title = run.get("software", "auv-cosim"), run.get("title") or run.get("scenario")
    text = f"The run “{title}” was co-simulated with {software}"
    if "end_ns" in run and "step_ns" in run:
        lasted_ns = int(run["end_ns"]) - int(run.get("start_ns", 0))
        text += f" for {_seconds(str(lasted_ns))} at communication steps of "
        text += _seconds(run["step_ns"])
    if "seed" in run:
        text += f", seed {run['seed']}"
    return f"{text}."


def _components(run: Mapping[str, Any]) -> str:
    names = [key[4:] for key in run if key.startswith("fmu.") and not key.endswith(".sha256")]
    if not names:
        return ""
    each = [
        f"{name} ({run[f'fmu.{name}']}, SHA-256 {str(run.get(f'fmu.{name}.sha256'))[:_SHORT]})"
        for name in names
    ]
    return f"Its components are {counted(len(names), 'FMU')}: {', '.join(each)}."


def _link(name: str, link: Any) -> str:
    if not isinstance(link, dict):
        return ""
    facts = []
    if isinstance(link.get("sample_time_ns"), int):
        facts.append(f"sends a message every {_seconds(link['sample_time_ns'])}")
    if isinstance(link.get("delay_ns"), int) and link["delay_ns"]:
        jitter = link.get("jitter")
        kind = jitter.get("kind") if isinstance(jitter, dict) else None
        more = f" and {kind} jitter" if kind not in (None, "none") else ""
        facts.append(f"delays it by {_seconds(link['delay_ns'])}{more}")
    if isinstance(link.get("recording"), dict):
        facts.append("replays a recording of a link")
    loss = link.get("loss")
    if isinstance(loss, dict):
        facts.append("loses messages in bursts")
    elif isinstance(loss, int | float) and loss:
        facts.append(f"loses it with probability {loss:g}")
    return f"The link {name} {', '.join(facts)}." if facts else ""


def _certificate(certificate: Mapping[str, Any] | None) -> str:
    if certificate is None:
        return "No gain of this run is certified."
    claim = certificate.get("claim")
    gamma = claim.get("gamma") if isinstance(claim, dict) else None
    bound = "" if gamma is None else f" with an H-infinity gain of at most {at_most(gamma)}"
    digest = str(certificate.get("sha256"))[:_SHORT]
    return (
        f"The controller's gain is certified in exact rational arithmetic{bound} (certificate "
        f"SHA-256 {digest}); the certificate names the hypotheses."
    )


def _outcome(outcome: Mapping[str, Any] | None) -> str:
    return "" if outcome is None else f"Outcome of the run: {outcome['headline']}."


def _trace(found: Mapping[str, Any], path: Path) -> str:
    digest = found["content_hash"]
    words = "" if digest is None else f", content hash {digest[:_SHORT]},"
    return f"The trace {path.name}{words} contains scenario, seeds and results, and can be rerun."


def _bibtex(found: Mapping[str, Any], path: Path) -> str:
    run = found["run"]
    name, _, version = str(run.get("software", "auv-cosim")).partition(" ")
    year = str(run.get("host.started", ""))[:4]
    software = {
        "author": "{The auv-cosim authors}",
        "title": f"{name}: certified control and co-simulation over slow links",
        "version": version,
        "year": year,
        "note": "MIT licence",
    }
    scenario = run.get("scenario", path.stem)
    notes = [f"scenario SHA-256 {run.get('scenario.sha256')}"]
    if found["content_hash"] is not None:
        notes.append(f"content hash {found['content_hash']}")
    trace = {
        "title": f"Trace of the run {scenario}: {run.get('title', scenario)}",
        "year": year,
        "howpublished": f"MCAP file {path.name}",
        "note": "; ".join(notes),
    }
    entries = (("software", name, software), ("misc", f"{name}-{scenario}", trace))
    return "\n\n".join(_entry(*entry) for entry in entries)


def _entry(kind: str, key: str, fields: Mapping[str, str]) -> str:
    lines = [
        f"  {field} = {{{value if field == 'author' else value.translate(_SPECIAL)}}},"
        for field, value in fields.items()
        if value
    ]
    return "\n".join([f"@{kind}{{{key},", *lines, "}"])


def _seconds(nanoseconds: Any) -> str:
    return f"{int(nanoseconds) / 1e9:g} s"
