"""`cosim certificate check` of what carries a certificate: FMUs and traces."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from cli.shell import BUILT_IN, SCENARIOS, cosim, shared_run, trace_of
from shared import sampled

from cosim.hinf.certificate import certificate_bytes, certificate_hash
from cosim.trace import Attachment, Trace, TraceWriter

CERTIFICATE, MODEL = "resources/certificate.json", "modelDescription.xml"
REFERENCE = Path(__file__).parents[2] / "traces" / "reference" / "paper-example.mcap"


def repacked(source: Path, target: Path, change: Mapping[str, bytes | None]) -> Path:
    """An FMU with some entries replaced, or left out where None."""
    with zipfile.ZipFile(source) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in {**files, **change}.items():
            if content is not None:
                archive.writestr(name, content)
    return target


def entry(fmu: Path, name: str) -> bytes:
    with zipfile.ZipFile(fmu) as archive:
        return archive.read(name)


@pytest.mark.parametrize("name", sampled(["HinfController", "PaperController"], 1))
def test_a_controller_is_proved_as_it_is_built(fmus: Path, name: str, tmp_path: Path) -> None:
    """Exit 0; carrier and SHA-256 are those of the entry in the archive."""
    fmu = fmus / f"{name}.fmu"
    result = cosim("certificate", "check", fmu, "--json", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["valid"] is True
    assert result.json["container"] == "FMU"
    assert result.json["sha256"] == hashlib.sha256(entry(fmu, CERTIFICATE)).hexdigest()
    seen = cosim("certificate", "check", fmu, cwd=tmp_path)
    assert "proved" in seen.out
    assert "any other" in seen.out


def another_start(model: bytes) -> bytes:
    return model.replace(b'start="0.6432"', b'start="0.6433"')


def one_entry_less(model: bytes) -> bytes:
    return model.replace(b'name="K[1,2]"', b'name="K2"')


def no_start(model: bytes) -> bytes:
    return model.replace(b' start="0.6432"', b"")


def text_start(model: bytes) -> bytes:
    return model.replace(b'start="0.6432"', b'start="much"')


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (another_start, "K[1,1] of the FMU is 0.6433, that of the certificate 0.6432"),
        (one_entry_less, "the FMU has 1 parameters K[i,j], the certificate 2 entries"),
        (no_start, "K[1,1] of the FMU is None"),
        (text_start, "K[1,1] of the FMU is much"),
    ],
)
def test_an_fmu_with_another_gain_is_not_proved(
    change: Callable[[bytes], bytes], message: str, fmus: Path, tmp_path: Path
) -> None:
    """The proof alone would hold: exit 1, and which entry is another one."""
    source = fmus / "PaperController.fmu"
    model = change(entry(source, MODEL))
    assert model != entry(source, MODEL)
    fmu = repacked(source, tmp_path / "other.fmu", {MODEL: model})
    result = cosim("certificate", "check", fmu, "--json", cwd=tmp_path)
    assert result.code == 1
    assert result.json["valid"] is False
    assert message in result.json["reason"]
    assert "not proved" in cosim("certificate", "check", fmu, cwd=tmp_path).out


def test_the_certificate_of_an_fmi_3_fmu_is_read(fmus: Path, tmp_path: Path) -> None:
    """There the start stands in the element itself."""
    variables = "".join(
        f'<Float64 name="K[1,{j}]" valueReference="{j}" causality="parameter" start="{value}"/>'
        for j, value in ((1, "6.432e-1"), (2, "-0.5679"))
    )
    model = (
        f'<fmiModelDescription fmiVersion="3.0"><ModelVariables>{variables}</ModelVariables>'
        "</fmiModelDescription>"
    )
    source = fmus / "PaperController.fmu"
    fmu = repacked(source, tmp_path / "three.fmu", {MODEL: model.encode()})
    assert cosim("certificate", "check", fmu, cwd=tmp_path).code == 0


def test_a_certificate_changed_in_the_fmu_is_not_proved(fmus: Path, tmp_path: Path) -> None:
    """A smaller gamma, claimed consistently: exit 1."""
    source = fmus / "PaperController.fmu"
    data = json.loads(entry(source, CERTIFICATE))
    data["claim"]["gamma"] = data["variables"]["gamma"] = "5"
    fmu = repacked(source, tmp_path / "bold.fmu", {CERTIFICATE: json.dumps(data).encode()})
    result = cosim("certificate", "check", fmu, "--json", cwd=tmp_path)
    assert result.code == 1
    assert "positive definite" in result.json["reason"]


REFUSED: dict[str, tuple[dict[str, bytes | None], str]] = {
    "without one": ({CERTIFICATE: None}, "carries no certificate"),
    "without a description": ({MODEL: None}, "not an FMU"),
    "no XML": ({MODEL: b"<fmi"}, "not XML"),
    "no JSON": ({CERTIFICATE: b"{"}, "not JSON"),
    "a list": ({CERTIFICATE: b"[]"}, "not a certificate"),
    "a number": ({CERTIFICATE: b"1"}, "not a certificate"),
    "K a number": ({CERTIFICATE: b'{"K": 1}'}, "missing"),
    "no text": ({CERTIFICATE: b"\xff\xfe"}, "not a certificate in JSON"),
    "too large": ({CERTIFICATE: b" " * (64 * 2**20 + 1)}, "is too large"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_fmu_without_a_certificate_is_refused(case: str, fmus: Path, tmp_path: Path) -> None:
    """Exit 2 and what is missing; an archive cannot make the check read without end."""
    change, message = REFUSED[case]
    fmu = repacked(fmus / "PaperController.fmu", tmp_path / "other.fmu", change)
    result = cosim("certificate", "check", fmu, "--json", cwd=tmp_path)
    assert result.code == 2
    assert message in result.error["what"]


def test_a_damaged_archive_is_refused(fmus: Path, tmp_path: Path) -> None:
    """Cut short, or one bit of the certificate flipped: exit 2, not an FMU."""
    whole = (fmus / "PaperController.fmu").read_bytes()
    flipped = bytearray(whole)
    flipped[whole.index(b'"claim"')] ^= 1
    for content in (whole[: len(whole) // 2], bytes(flipped)):
        (tmp_path / "cut.fmu").write_bytes(content)
        result = cosim("certificate", "check", "cut.fmu", "--json", cwd=tmp_path)
        assert result.code == 2
        assert result.error["what"] == "not an FMU"
    (tmp_path / "folder.fmu").mkdir()
    assert cosim("certificate", "check", "folder.fmu", cwd=tmp_path).code == 2


@pytest.mark.parametrize("name", sampled(BUILT_IN, 2))
def test_every_trace_contains_the_certificate_of_its_gain(name: str, tmp_path: Path) -> None:
    """Attached, named in the run with its SHA-256 and claim, and the same as in the design."""
    trace = Trace(trace_of(name))
    proof = trace.attachments["certificate.json"]
    design = json.loads(trace.attachments["design.json"])
    assert proof == certificate_bytes(design)
    assert trace.run["certificate.sha256"] == hashlib.sha256(proof).hexdigest()
    assert json.loads(trace.run["certificate.claim"]) == json.loads(proof)["claim"]
    checked = cosim("certificate", "check", trace_of(name), "--json", cwd=tmp_path)
    assert checked.code == 0, checked.err
    assert checked.json["container"] == "trace"
    assert checked.json["claim"] == design["claim"]
    reported = cosim("trace", "info", trace_of(name), "--json", cwd=tmp_path).json["certificate"]
    assert reported["sha256"] == checked.json["sha256"] == certificate_hash(design)
    assert reported["attachment"] == "certificate.json"
    assert reported["claim"] == design["claim"]


def test_the_trace_records_whether_the_fmu_starts_with_its_gain() -> None:
    """The gain for the acoustic link is the one HinfController is built with; the naive is not."""
    gains = {name: Trace(trace_of(name)).run["certificate.gain"] for name in BUILT_IN}
    prefix = "K[i,j] of controller as set for this run; its FMU starts with"
    assert gains["auv-acoustic"] == f"{prefix} it"
    assert gains["auv-acoustic-naive"] == f"{prefix} another, which did not fly"
    assert gains["paper-example"] == f"{prefix} it"


def test_people_see_the_certificate_in_info(tmp_path: Path) -> None:
    """Claim, bound, delays and hash in words."""
    seen = cosim("trace", "info", trace_of("auv-acoustic"), "--details", cwd=tmp_path).out
    run = Trace(trace_of("auv-acoustic")).run
    assert "stability and H-infinity gain <= gamma, gamma = 3.36" in seen
    assert "d = 1.25 s: age any, however it varies, up to d, the control acts through it" in seen
    assert run["certificate.sha256"][:16] in seen
    assert run["certificate.gain"] in seen


def test_a_trace_of_an_earlier_version_is_proved_too(tmp_path: Path) -> None:
    """There the proof is inside the design."""
    assert "certificate.json" not in Trace(REFERENCE).attachments
    result = cosim("certificate", "check", REFERENCE, "--json", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["container"] == "trace"
    assert cosim("trace", "info", REFERENCE, "--json", cwd=tmp_path).json["certificate"] is None


def test_another_proof_in_a_trace_is_noticed(tmp_path: Path) -> None:
    """A valid proof that is not the one the run names: exit 1."""
    run = Trace(trace_of("paper-example")).run
    other = Trace(trace_of("auv-direct")).attachments["certificate.json"]
    with TraceWriter(
        tmp_path / "t.mcap",
        run=run,
        attachments=[Attachment("certificate.json", "application/json", bytes(other))],
    ) as writer:
        writer.finish({"status": "finished"})
    result = cosim("certificate", "check", "t.mcap", "--json", cwd=tmp_path)
    assert result.code == 1
    assert "not the one of the run" in result.json["reason"]


def test_a_trace_without_a_design_has_none(fmus: Path, tmp_path: Path) -> None:
    """Nothing was promised: exit 2 for the check, nothing in info."""
    plain = SCENARIOS / "valid" / "plain.toml"
    assert cosim("run", plain, "--fmus", fmus.parent, "--out", "t.mcap", cwd=tmp_path).code == 0
    result = cosim("certificate", "check", "t.mcap", "--json", cwd=tmp_path)
    assert result.code == 2
    assert "carries no certificate" in result.error["what"]
    assert cosim("trace", "info", "t.mcap", "--json", cwd=tmp_path).json["certificate"] is None


@pytest.mark.parametrize("claim", ["", "{", "NaN", "[1]", '{"gamma": "1/0", "delays": 3}'])
def test_info_accepts_any_claim(claim: str, tmp_path: Path) -> None:
    """What a foreign writer puts there is shown as far as it can be read."""
    run = {"certificate.sha256": "0", "certificate.claim": claim}
    with TraceWriter(tmp_path / "t.mcap", run=run) as writer:
        writer.finish({"status": "finished"})
    assert cosim("trace", "info", "t.mcap", cwd=tmp_path).code == 0
    reported = cosim("trace", "info", "t.mcap", "--json", cwd=tmp_path)
    assert reported.code == 0
    assert reported.json["certificate"]["sha256"] == "0"


def test_the_certificate_is_part_of_the_record(tmp_path: Path) -> None:
    """Two proofs of the same run: the same content, and a difference that `trace diff` names."""
    assert shared_run("paper-example").code == 0
    run = Trace(trace_of("paper-example")).run
    for name, sha256 in (("a", run["certificate.sha256"]), ("b", "0" * 64)):
        entries = {**run, "certificate.sha256": sha256}
        with TraceWriter(tmp_path / f"{name}.mcap", run=entries) as writer:
            writer.finish({"status": "finished"})
    found = cosim("trace", "diff", "a.mcap", "b.mcap", "--json", cwd=tmp_path)
    assert found.json["identical"]
    assert "certificate.sha256" in found.out
