"""FMUs run in a process of their own: sound ones, and every kind of failure."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest
from fmu.packed import compiled, files_of, functions_of_fmi2, pack, with_file
from shared import sampled

from cosim.fmu.export import CATALOGUE, host
from cosim.fmu.inspect import inspect_fmu, run_findings

XML = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Tiny" guid="{1}">
 <CoSimulation modelIdentifier="Tiny" canGetAndSetFMUstate="true" canSerializeFMUstate="true"/>
 <DefaultExperiment startTime="0" stopTime="1" stepSize="0.1"/>
 <ModelVariables>
  <ScalarVariable name="p" valueReference="0" causality="parameter" variability="fixed">
   <Real start="2"/></ScalarVariable>
  <ScalarVariable name="y" valueReference="1" causality="output" initial="exact">
   <Real start="0"/></ScalarVariable>
 </ModelVariables>
 <ModelStructure><Outputs><Unknown index="2" dependencies=""/></Outputs></ModelStructure>
</fmiModelDescription>
"""

# y is the number of steps; each flaw is one macro
SOURCE = r"""
#include <stdlib.h>
#include <string.h>
#include <math.h>
#include <unistd.h>
typedef void *C; typedef unsigned R;
typedef void (*Log)(void *, const char *, int, const char *, const char *, ...);
typedef struct { Log log; void *a, *f, *s, *env; } Callbacks;
typedef struct { double p, y, hidden; Log log; void *env; } M;
#ifndef FLAW
#define FLAW 0
#endif
enum { NONE, CRASH, HANG, EXIT, REFUSE, NOTFINITE, STATE, BYTES, RESET, START, FREE, NOINSTANCE,
       INIT, UNLOAD };
C fmi2Instantiate(const char *n, int t, const char *g, const char *r, const Callbacks *c, int v,
                  int l) {
  if (FLAW == NOINSTANCE) { c->log(c->env, n, 3, "e", "no licence for %s", n); return 0; }
  M *m = calloc(1, sizeof *m); m->p = FLAW == START ? 3 : 2; m->log = c->log; m->env = c->env;
  return m; }
void fmi2FreeInstance(C c) { if (FLAW == FREE) abort(); free(c); }
int fmi2SetupExperiment(C c, int a, double b, double d, int e, double f) { return 0; }
int fmi2EnterInitializationMode(C c) {
  M *m = c; if (FLAW != INIT) return 0;
  m->log(m->env, "i", 3, "e", "p = %g is too small", m->p); return 3; }
int fmi2ExitInitializationMode(C c) { return 0; }
int fmi2Terminate(C c) { return 0; }
int fmi2Reset(C c) { M *m = c; if (FLAW != RESET) m->y = 0; return 0; }
int fmi2GetReal(C c, const R *r, size_t n, double *v) {
  M *m = c; for (size_t i = 0; i < n; i++) v[i] = r[i] ? m->y : m->p; return 0; }
int fmi2SetReal(C c, const R *r, size_t n, const double *v) { return 0; }
int fmi2DoStep(C c, double t, double h, int k) {
  M *m = c; m->y += 1 + (FLAW == STATE ? 1e-3 * m->hidden++ : 0);
  if (FLAW == CRASH) *(volatile int *)0 = 1;
  if (FLAW == HANG) for (;;) sleep(1);
  if (FLAW == EXIT) exit(0);
  if (FLAW == REFUSE && m->y > 2) { m->log(m->env, "i", 2, "e", "stiff at %d", 2); return 2; }
  if (FLAW == NOTFINITE) m->y = NAN;
  return 0; }
int fmi2GetFMUstate(C c, C *s) { double *d = malloc(16); *d = ((M *)c)->y; *s = d; return 0; }
int fmi2SetFMUstate(C c, C s) { ((M *)c)->y = *(double *)s; return 0; }
int fmi2FreeFMUstate(C c, C *s) { free(*s); *s = 0; return 0; }
int fmi2SerializedFMUstateSize(C c, C s, size_t *n) { *n = 8; return 0; }
int fmi2SerializeFMUstate(C c, C s, char *b, size_t n) { memcpy(b, s, 8); return 0; }
int fmi2DeSerializeFMUstate(C c, const char *b, size_t n, C *s) {
  double *d = malloc(16); memcpy(d, b, 8); if (FLAW == BYTES) *d += 1; *s = d; return 0; }
__attribute__((destructor)) static void bye(void) { if (FLAW == UNLOAD) abort(); }
"""
STUBS = "".join(
    f"int {name}(void) {{ return 3; }}\n"
    for name in functions_of_fmi2()
    if f" {name}(" not in SOURCE
)
PATIENCE_S = 600.0
"""Of a machine with other things to do."""
FLAWS = {
    "CRASH": ("run-crash", "error", "SIGSEGV"),
    "HANG": ("run-timeout", "error", "no answer within 3 s"),
    "EXIT": ("run-crash", "error", "exit code 0"),
    "REFUSE": ("run-refused", "error", "fmi2DoStep failed with status 2"),
    "NOTFINITE": ("run-not-finite", "warning", "not finite"),
    "STATE": ("run-state", "warning", "state"),
    "BYTES": ("run-serialized", "warning", "serialized"),
    "RESET": ("run-reset", "warning", "reset"),
    "START": ("run-start", "warning", "p is 3.0, described as 2"),
    "FREE": ("run-end", "error", "SIGABRT"),
    "NOINSTANCE": ("run-broken", "error", "Failed to instantiate"),
    "INIT": ("run-refused", "error", "fmi2EnterInitializationMode failed with status 3"),
    "UNLOAD": ("run-end", "error", "SIGABRT"),
}
HERE = host().fmi2


def tiny(tmp_path: Path, flaw: str, more: str = "") -> Path:
    """The FMU with one flaw and more C, for this machine."""
    if HERE not in ("linux32", "linux64"):
        pytest.skip("needs Linux on a processor that FMI 2 names")
    library = compiled(tmp_path, SOURCE + STUBS + more, "Tiny", f"-DFLAW={flaw}")
    binary = {f"binaries/{HERE}/Tiny.so": library.read_bytes()}
    return pack({"modelDescription.xml": XML.encode(), **binary}, tmp_path / "Tiny.fmu")


def run(path: Path, seconds: float = PATIENCE_S) -> list[Any]:
    """The findings of a run of an FMU."""
    return run_findings(inspect_fmu(path), seconds)


@pytest.mark.parametrize("name", sampled(["AuvPlant", "PaperController", "WaveField"], 1))
def test_built_in_fmus_run_without_findings(fmus: Path, name: str) -> None:
    """Set up, step, save, restore, serialise, reset, end: all equal to the last bit."""
    assert name in CATALOGUE
    (done,) = run(fmus / f"{name}.fmu")
    assert done.code == "run-done"
    for stage in ("save", "restore", "serialize", "reset", "terminate", "free", "5 steps"):
        assert stage in done.what


def test_sound_library_runs_without_findings(tmp_path: Path) -> None:
    """The source of the flawed libraries has no finding without its flaws."""
    assert [f.code for f in run(tiny(tmp_path, "NONE"))] == ["run-done"]


@pytest.mark.parametrize("flaw", FLAWS)
def test_each_flaw_gives_its_finding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flaw: str
) -> None:
    """Each flaw is found within the time limit, and no file is left behind."""
    code, level, words = FLAWS[flaw]
    path = tiny(tmp_path, flaw)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    found = {f.code: f for f in run(path, seconds=3.0 if flaw == "HANG" else PATIENCE_S)}
    assert (found[code].level, words in found[code].what) == (level, True), found
    assert [each.name for each in scratch.glob("*/*")] == []  # in this process's own folder


def test_only_a_run_loads_the_binary(tmp_path: Path) -> None:
    """A library that writes a file when it is loaded writes none during an inspection."""
    mark = tmp_path / "loaded"
    trap = f"""
#include <stdio.h>
__attribute__((constructor)) static void hello(void) {{ fclose(fopen("{mark}", "w")); }}
"""
    path = tiny(tmp_path, "NONE", trap)
    report = inspect_fmu(path)
    assert report.valid
    assert not mark.exists()
    run(path)
    assert mark.exists()


def test_messages_of_the_fmu_are_reported_with_their_numbers(tmp_path: Path) -> None:
    """The FMU's printf-like message, formatted, with its status."""
    logged = [f for f in run(tiny(tmp_path, "INIT")) if f.code == "run-log"]
    assert [(f.level, f.what) for f in logged] == [("warning", "error: p = 2 is too small")]


@pytest.mark.slow
def test_library_that_does_not_load(fmus: Path, tmp_path: Path) -> None:
    """A library with its code cut off, and none for this machine."""
    files = files_of(fmus / "WaveField.fmu")
    name = "binaries/linux64/WaveField.so"
    with_file(name, files[name][:20_000])(files)
    assert {f.code for f in run(pack(files, tmp_path / "cut.fmu"))} & {"run-load", "run-crash"}
    del files[name]
    assert [f.code for f in run(pack(files, tmp_path / "none.fmu"))] == ["run-absent"]


def test_hostile_archive_is_never_unpacked_to_run(fmus: Path, tmp_path: Path) -> None:
    """A path that leaves the folder: nothing is written, nothing is run."""
    files = files_of(fmus / "WaveField.fmu")
    files["../outside.txt"] = b""
    path = pack(files, tmp_path / "hostile.fmu")
    before = set(tmp_path.rglob("*"))
    assert [f.code for f in run(path)] == ["run-absent"]
    assert set(tmp_path.rglob("*")) == before
