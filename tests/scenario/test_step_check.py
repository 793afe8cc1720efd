"""The check of the communication step: its estimates against exact solutions, and its verdicts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim
from master.scalar import scalar_fmu
from numpy.typing import NDArray
from scipy.linalg import expm
from shared import sampled

from cosim.core import InputError
from cosim.scenario import FmuCache, StepCheck, check_step, parse, prepare, run
from cosim.trace import Trace

A, B, START, STOP = (-1.0, -0.5), (1.5, -2.0), (1.0, -0.5), 2.0
LOOP = """
title = "Two scalars in a loop"
[run]
end = 2.0
step = 0.05
MORE
[components.a]
fmu = "scalar.fmu"
parameters = { a = -1.0, b = 1.5, x0 = 1.0 }
[components.b]
fmu = "scalar.fmu"
parameters = { a = -0.5, b = -2.0, x0 = -0.5 }
[[connections]]
from = "a.x"
to = "b.u"
POLICY
[[connections]]
from = "b.x"
to = "a.u"
POLICY
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("step")
    scalar_fmu(place).rename(place / "scalar.fmu")
    return place


def text_of(more: str = "", policy: str = "") -> str:
    return LOOP.replace("MORE", more).replace("POLICY", policy)


def checked(folder: Path, text: str, **more: Any) -> StepCheck:
    loaded = parse(text, name="loop", where="loop.toml", folder=folder)
    return check_step(prepare(loaded, FmuCache(folder, folder)), **more)


def exact(seconds: NDArray[np.float64]) -> NDArray[np.float64]:
    """x of a and b, (points, 2)."""
    matrix = np.array([[A[0], B[0]], [B[1], A[1]]])
    return np.array([expm(matrix * t) @ START for t in seconds])


def errors(folder: Path, text: str, tmp_path: Path) -> dict[str, float]:
    """The true largest error of each state at the step of the scenario."""
    (folder / "true.toml").write_text(text)
    trace = tmp_path / "true.mcap"
    run(folder / "true.toml", trace, fmus=folder)
    found = {}
    for i, name in enumerate("ab"):
        table = Trace(trace).read(f"/{name}/output")
        truth = exact(table.log_time_ns / 1e9)[:, i]
        found[f"{name}.x"] = float(np.abs(table.columns["x"] - truth).max())
    return found


@pytest.mark.parametrize("observe", sampled([False, True], 1))
@pytest.mark.parametrize(
    ("more", "policy", "order"),
    [
        ("", "", 1),
        ('algorithm = "gauss-seidel"', "", 1),
        ("", 'policy = "linear"', 2),
        ("", 'policy = "previous"', 1),
    ],
)
def test_estimate_is_within_a_factor_of_two_of_the_true_error(
    folder: Path, tmp_path: Path, more: str, policy: str, order: int, *, observe: bool
) -> None:
    text = text_of(more, policy)
    check = checked(folder, text, observe_order=observe)
    assert check.order == order
    assert check.steps_s == (0.05, 0.025, 0.0125)[: 2 + observe]
    estimated = {s.name: s for s in check.signals}
    assert set(estimated) == {"a.x", "a.y", "b.x", "b.y"}
    for name, truth in errors(folder, text, tmp_path).items():
        found = estimated[name]
        assert found.error is not None
        assert 0.5 < found.error / truth < 2.0, name
        if observe:
            assert found.observed_order == pytest.approx(order, abs=0.3)
        else:
            assert found.observed_order is None


def test_cut_loop_is_of_order_one_whatever_its_policies(tmp_path: Path) -> None:
    """The cut connection is delayed by a step in place of being extrapolated."""
    scalar_fmu(tmp_path, declared=False).rename(tmp_path / "scalar.fmu")
    text = text_of('unknown_feedthrough = "previous"', 'policy = "linear"')
    check = checked(tmp_path, text, observe_order=True)
    assert check.order == 1
    observed = {s.name: s.observed_order for s in check.signals}
    assert observed["a.x"] == pytest.approx(1.0, abs=0.3)


def test_difference_is_that_of_two_runs(folder: Path, tmp_path: Path) -> None:
    """Its size and its time, from the traces of the two runs; the range is that of the finer."""
    found = {s.name: s for s in checked(folder, text_of()).signals}["b.x"]
    rows = []
    (folder / "two.toml").write_text(text_of())
    for step in (0.05, 0.025):
        trace = tmp_path / f"{step}.mcap"
        run(folder / "two.toml", trace, settings=[f"run.step={step}"], fmus=folder)
        rows.append(Trace(trace).read("/b/output").columns["x"])
    apart = np.abs(rows[0] - rows[1][::2])
    assert found.difference == apart.max()
    assert found.at_s == pytest.approx(0.05 * int(np.argmax(apart)))
    assert found.span == rows[1][::2].max() - rows[1][::2].min()


def test_verdict_follows_the_tolerance_and_the_suggested_step_meets_it(folder: Path) -> None:
    loose = checked(folder, text_of(), tolerance=0.5)
    assert (loose.verdict, loose.suggested_step_s) == ("yes", None)
    tight = checked(folder, text_of(), tolerance=0.003)
    assert tight.verdict == "no"
    assert tight.suggested_step_s is not None
    assert tight.suggested_step_s < 0.05
    nanoseconds = int(tight.suggested_step_s * 0.9e9) // 1_000_000 * 1_000_000
    finer = text_of().replace("step = 0.05", f"step = {nanoseconds / 1e9}")
    assert checked(folder, finer, tolerance=0.003).verdict == "yes"


def test_what_does_not_depend_on_the_step_has_no_error(folder: Path) -> None:
    """Aligned packets: the differences are rounding, and no order is made of them."""
    text = text_of().replace("POLICY", "")
    for name, times in (("there", (0.07, 0.0331)), ("back", (0.05, 0.0207))):
        text = text.replace('to = "b.u"' if name == "there" else 'to = "a.u"', "TARGET")
        target = "b.u" if name == "there" else "a.u"
        text = text.replace("TARGET", f'to = "{target}"\nlink = "{name}"')
        text += f'[links.{name}]\nkind = "packet"\nsample_time = {times[0]}\ndelay = {times[1]}\n'
    check = checked(folder, text, observe_order=True)
    assert check.verdict == "yes"
    for signal in check.signals:
        assert signal.error is not None
        assert signal.error < 1e-13
        assert signal.observed_order is None


def test_run_that_diverges_is_not_judged(folder: Path) -> None:
    text = text_of("divergence = 1.5", "").replace("b = 1.5", "b = 15.0")
    check = checked(folder, text)
    assert check.verdict == "unclear"
    assert "diverged" in check.reason
    assert check.statuses == ("diverged", "finished")


def test_differences_that_do_not_shrink_are_not_judged(folder: Path) -> None:
    """An oscillation of 36 rad/s, of which none of the three steps has the phase."""
    text = text_of('algorithm = "gauss-seidel"')
    for old, new in (
        ("a = -1.0, b = 1.5", "a = 0.0, b = 36.0"),
        ("a = -0.5, b = -2.0", "b = -36.0, a = 0.0"),
    ):
        text = text.replace(old, new)
    assert checked(folder, text).verdict == "no"
    check = checked(folder, text, observe_order=True)
    assert check.verdict == "unclear"
    assert "the estimate does not hold" in check.reason
    assert check.suggested_step_s is None


def test_step_that_cannot_be_halved_is_refused(folder: Path) -> None:
    for step, observe in ((0.050000001, False), (0.050000002, True)):
        text = text_of().replace("step = 0.05", f"step = {step}")
        with pytest.raises(InputError, match="cannot be divided by") as caught:
            checked(folder, text, observe_order=observe)
        assert "`set` run.step=0.05" in str(caught.value)
    for tolerance in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="tolerance"):
            checked(folder, text_of(), tolerance=tolerance)


def test_command_says_whether_the_step_is_small_enough(folder: Path) -> None:
    """For people and as JSON; the exit code is 1 only beyond a tolerance that was given."""
    (folder / "s.toml").write_text(text_of())
    words = ("run", "s.toml", "--check-step", "--fmus", folder)
    people = cosim(*words, cwd=folder)
    assert people.code == 0, people.err
    assert "the step is too long" in people.out
    assert "--check-order" in people.out
    assert "a.x" in people.out
    observed = cosim(*words, "--check-order", "--json", cwd=folder)
    assert observed.code == 0
    assert observed.json["verdict"] == "no"
    assert observed.json["signals"][0]["observed_order"] == pytest.approx(1.0, abs=0.3)
    assert cosim(*words, "--check-tolerance", "0.0001", cwd=folder).code == 1
    assert cosim(*words, "--check-tolerance", "0.9", cwd=folder).code == 0
    assert not list(folder.rglob("*.mcap"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--check-step", "--out", "x.mcap"), "--out has no effect with --check-step"),
        (("--check-step", "--pace", "1"), "--pace has no effect with --check-step"),
        (("--check-step", "--fsync"), "--fsync has no effect with --check-step"),
        (("--check-tolerance", "0.1"), "add --check-step"),
        (("--check-order",), "add --check-step"),
        (("--check-step", "--check-tolerance", "0"), "this is no tolerance"),
    ],
)
def test_options_that_do_not_belong_together_are_refused(
    folder: Path, options: tuple[str, ...], message: str
) -> None:
    (folder / "s.toml").write_text(text_of())
    done = cosim("run", "s.toml", *options, "--fmus", folder, cwd=folder)
    assert done.code == 2
    assert message in done.err
