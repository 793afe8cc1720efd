"""The faces of the product, one function each: what it says of a file of the corpus.

Each takes the name of a file and a folder of its own to write to, and returns JSON values.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cli.shell import cosim
from content_hashes import former_hash, in_format_1, plain_hash
from corpus.files import corpus
from shared import copied

from cosim.core import InputError
from cosim.hinf import check_certificate, system_by_name
from cosim.hinf.certificate import read_certificate, standalone
from cosim.hinf.certificate.standalone import RefusedError
from cosim.study import read_table
from cosim.trace import Trace
from cosim.trace.outcome import assumptions_of, guarantee_of, outcome_of

_STORE = ("--fmus", "store")
_HASH = "content_hash"


def _command(*words: str | Path, folder: str = ".") -> tuple[int, dict[str, Any]]:
    """Exit code and JSON of a command in a folder of the corpus; the error where there is one."""
    result = cosim(*words, "--json", cwd=corpus() / folder)
    return result.code, result.json if result.out else {}


def _kept_keys(data: dict[str, Any], *keys: str) -> dict[str, Any]:
    """Those of these keys that are there; of an error its sentence and place."""
    if "error" in data:
        return {"error": {key: data["error"][key] for key in ("what", "where")}}
    return {key: data[key] for key in keys if key in data}


def _digest(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def _hash_of(printed: dict[str, Any], trace: Path) -> dict[str, Any]:
    """The content hash that was printed, as the version had it that gave the recorded answers.

    That version wrote row format 1, whose hash is another one: so the same rows are written in it.
    """
    if printed.get(_HASH) is None:
        return _kept_keys(printed, _HASH)
    assert printed[_HASH] == plain_hash(trace), trace
    return {_HASH: former_hash(in_format_1(trace, trace.with_suffix(".then.mcap")))}


def verdict_of(path: Path) -> dict[str, Any]:
    """What the trace at `path` says of the guarantee: its tone, in words, and what was not met."""
    outcome = outcome_of(Trace(path, incomplete=True).result)
    checks = [] if outcome is None else assumptions_of(outcome)
    verdict = None if outcome is None else guarantee_of(outcome, checks)
    return {
        "verdict": verdict and verdict.tone,
        "words": verdict and f"{verdict.what}: {verdict.why}",
        "not_met": [check.what for check in checks if check.tone != "good"],
    }


def certificate(name: str, _: Path) -> dict[str, Any]:
    """Both checkers, and the comparison with the system file of the same name."""
    own = f"systems/{Path(name).stem}.toml"
    more = ("--system", own) if name.endswith(".json") and (corpus() / own).exists() else ()
    code, data = _command("certificate", "check", name, *more)
    answer = {"code": code, **_kept_keys(data, "container", "sha256", "valid", "reason")}
    answer |= _kept_keys(data, "claim", "differences")
    if not name.endswith(".json"):
        return answer
    try:
        answer["prover"] = check_certificate(read_certificate(corpus() / name)).valid
    except InputError as error:
        answer["prover"] = error.what
    try:
        proved = standalone.check((corpus() / name).read_bytes())
        answer["standalone"] = json.loads(json.dumps(proved, default=str))
    except RefusedError as refused:
        answer["standalone"] = str(refused)
    return answer


def system(name: str, _: Path) -> dict[str, Any]:
    """The matrices that a system file is read as."""
    found = system_by_name(str(corpus() / name))
    return {"name": found.system.name, "system": repr(found.system)}


def fmu(name: str, _: Path) -> dict[str, Any]:
    """What it declares, and the rules it breaks."""
    _, data = _command("fmu", "info", name)
    info = {**data, **data["model"]}
    code, checked = _command("fmu", "check", name)
    keys = ("sha256", "fmi_version", "name", "token", "kinds", "platforms")
    found = [[one["number"], one["level"]] for one in checked["findings"]]
    declared = info["variables"]  # under another name: it is no certificate
    return {**_kept_keys(info, *keys), "declared": declared, "code": code, "findings": found}


def trace(name: str, _: Path) -> dict[str, Any]:
    """What it contains, whether it is sound, what it says of the guarantee."""
    code, info = _command("trace", "info", name)
    keys = ("complete", "finished", "links", "outcome", "certificate", "log", "message_count")
    topics = {
        topic["topic"]: [topic["count"], topic["schema"], _digest(repr(topic["signals"]).encode())]
        for topic in info["topics"]
    }
    run = {key: value for key, value in info["run"].items() if not key.startswith("host.")}
    checked, verified = _command("trace", "verify", name)
    checks = {one["name"]: one["verdict"] for one in verified["checks"]}
    answer = {"info": code, **_kept_keys(info, *keys, "content_hash"), "topics": topics, "run": run}
    return {**answer, "verify": checked, "checks": checks, **verdict_of(corpus() / name)}


def export(name: str, place: Path) -> dict[str, Any]:
    """Digests of its tables as text and as Parquet."""
    answer: dict[str, Any] = {}
    for kind in ("csv", "parquet"):
        code, data = _command("trace", "export", name, "--to", kind, "--out", place / kind)
        answer[kind] = {"code": code, **_kept_keys(data)}
    tables = sorted((place / "csv").glob("**/*.csv"))
    answer["csv"]["tables"] = {path.name: _digest(path.read_bytes()) for path in tables}
    answer["parquet"]["tables"] = {
        path.name: _values(path) for path in sorted((place / "parquet").glob("**/*.parquet"))
    }
    return answer


def _values(path: Path) -> str:
    """A digest of the values of a Parquet file, whatever the version that packed them."""
    from pyarrow import parquet  # noqa: PLC0415 - an extra

    table = parquet.read_table(path)
    columns = zip(table.column_names, table.columns, strict=True)
    return _digest(*(f"{name}{column.to_pylist()}".encode() for name, column in columns))


def report(name: str, place: Path) -> dict[str, Any]:
    """What the command says of the report that it writes."""
    result = cosim("trace", "report", name, "--out", place / "r.html", cwd=corpus(), columns=1000)
    return {"code": result.code, "said": result.out.splitlines()[1:]}


def rerun(name: str, place: Path) -> dict[str, Any]:
    """Whether it is the same again; paths in it start from where its scenario was."""
    out = place / "again.mcap"
    folder = "flight" if name == "traces/flight.mcap" else "scenarios"
    words = ("trace", "rerun", f"../{name}", "--fmus", "..", "--out", out)
    code, data = _command(*words, folder=folder)
    answer = {"code": code, **_kept_keys(data, "identical", "finished", "differences")}
    return {**answer, **(verdict_of(out) if out.exists() else {})}


def scenario(name: str, place: Path) -> dict[str, Any]:
    """What a run says."""
    out = place / "run.mcap"
    checked, _ = _command("scenario", "check", name, *_STORE)
    code, data = _command("run", name, *_STORE, "--out", out)
    keys = ("status", "reason", "cause", "steps", "simulated_s", "assertions", "links", "final")
    answer = {"check": checked, "code": code, **_kept_keys(data, *keys), **_hash_of(data, out)}
    metrics = data.get("metrics") or {}
    answer["metrics"] = {key: value for key, value in metrics.items() if key != "assumptions"}
    return {**answer, **(verdict_of(out) if out.exists() else {})}


def ssp(name: str, place: Path) -> dict[str, Any]:
    """The run of the scenario that it is imported as."""
    imported, out = place / "imported.toml", place / "run.mcap"
    code, _ = _command("ssp", "import", name, "--out", imported)
    ended, run = _command("run", imported, *_STORE, "--out", out)
    answer = {"import": code, "code": ended}
    answer |= {**_kept_keys(run, "status", "steps"), **_hash_of(run, out)}
    return {**answer, **verdict_of(out)}


def link(name: str, _: Path) -> dict[str, Any]:
    """What it was like, and what a proof across outages says of it."""
    code, data = _command("link", "show", name)
    design = ("--design", "certificates/outages.json")
    judged, verdict = _command("link", "verdict", name, *design)
    answer = {"show": code, "links": data["links"], "verdict": judged}
    return {**answer, "judged": verdict.get("links"), **_kept_keys(verdict)}


def vehicle(name: str, _: Path) -> dict[str, Any]:
    """What is found wrong with it, and its trim and mass matrix."""
    checked, _data = _command("vehicle", "check", name)
    code, data = _command("vehicle", "show", name)
    keys = ("name", "degrees_of_freedom", "states", "mass_matrix", "trim")
    return {"check": checked, "code": code, **_kept_keys(data, *keys)}


def study(name: str, place: Path) -> dict[str, Any]:
    """The table of a study that is done, continued, or merged of its parts."""
    folder = Path(name).parent
    if name == _MERGED:
        parts = ("results/part-1", "results/part-2")
        code, data = _command("study", "merge", *parts, "--out", place / "all")
    else:
        copied(corpus() / folder, place / "all")
        words = ("studies/delays.toml", *_STORE, "--out", place / "all")
        code, data = _command("study", "run", *words)
    answer = {"code": code, **_kept_keys(data)}
    if "error" in data:
        return answer
    table, manifest = read_table(place / "all")
    rows = {column: table[column].to_pylist() for column in table.column_names}
    kept_columns = {column: rows[column] for column in rows if "wall" not in column}
    return {**answer, "digest": manifest["digest"], "rows": kept_columns}


def migrate(name: str, _: Path) -> dict[str, Any]:
    """Whether the version of its keys is the newest, and what it is taken for."""
    code, data = _command("migrate", "--check", name)
    return {"code": code, **_kept_keys(data), "kinds": [one["kind"] for one in data["files"]]}


def diff(name: str, _: Path) -> dict[str, Any]:
    """The comparison of a trace with that of the loop."""
    code, data = _command("trace", "diff", "traces/loop.mcap", name)
    return {"code": code, **_kept_keys(data, "identical", "equal", "first")}


_MERGED = "results/part-1 and results/part-2"
TOGETHER = (_MERGED,)
"""Asked about, though no file."""


def _in(folder: str, *ends: str) -> Callable[[str], bool]:
    return lambda name: name.startswith(f"{folder}/") and name.endswith(ends)


FACES: dict[str, tuple[Callable[[str], bool], Callable[[str, Path], dict[str, Any]]]] = {
    "system": (_in("systems", ".toml"), system),
    "certificate": (
        lambda name: (
            name.endswith((".json", ".mcap", ".fmu"))
            and name.startswith(("certificates/", "flight/", "fmus/", "traces/"))
        ),
        certificate,
    ),
    "fmu": (lambda name: name.endswith(".fmu"), fmu),
    "trace": (_in("traces", ".mcap", ".partial"), trace),
    "export": (_in("traces", ".mcap", ".partial"), export),
    "report": (_in("traces", ".mcap", ".partial"), report),
    "diff": (_in("traces", ".mcap"), diff),
    "rerun": (_in("traces", ".mcap", ".partial"), rerun),
    "scenario": (
        lambda name: name == "flight/scenario.toml" or _in("scenarios", ".toml")(name),
        scenario,
    ),
    "ssp": (_in("ssp", ".ssp"), ssp),
    "link": (_in("links", ".csv"), link),
    "vehicle": (
        lambda name: name == "flight/vehicle.toml" or _in("vehicles", ".toml")(name),
        vehicle,
    ),
    "study": (lambda name: name == _MERGED or name.endswith("/study.json"), study),
    "migrate": (_in("systems", ".toml"), migrate),
}
"""By name: which files it is asked about, and how."""
