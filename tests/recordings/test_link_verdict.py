"""What a proof across outages says of a recorded link."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from cli.shell import cosim
from shared import sampled
from truth.touch import in_touch

from cosim import hinf
from cosim.core import InputError
from cosim.models import Delay, DelaySystem
from cosim.network import Recording
from cosim.recordings import HiddenChain, outage_verdict, write_recordings

S = 10**9
D = 2.4
K = np.array([[-0.1 / D**2, -0.3 / D]])
AXIS = DelaySystem(
    A=[[0, 1], [0, -0.05]],
    B=[[0], [1]],
    delays=[Delay(D, np.zeros((2, 2)), feedback=True, any_age=True)],
)
BAD = HiddenChain(np.array([[0.93, 0.07], [0.02, 0.98]]), np.array([0.06, 0.96]))
MILD = HiddenChain(np.array([[0.985, 0.015], [0.2, 0.8]]), np.array([0.02, 0.9]))


@cache
def proved() -> hinf.Result:
    """A gain for messages each second."""
    return hinf.synthesis.with_outages(hinf.analyse(AXIS, K, order=0), alpha=0.045)


def recording(chain: HiddenChain, count: int = 900, copy: int = 0) -> Recording:
    """A message each second, each .2 to .4 s under way."""
    lost = chain.simulate(count, copy + 1, "verdict")[:, copy]
    late = np.random.default_rng(copy).integers(S // 5, 2 * S // 5, count)
    return Recording(np.arange(count) * S, lost, late)


@pytest.mark.parametrize("copy", range(3))
def test_touch_is_what_its_definition_says_at_any_instant(copy: int) -> None:
    """Between each two sendings: of a recording that ends later there is so much more.

    Some messages arrive after later ones, some not before the end, which is as if they were lost.
    """
    lost = recording(BAD, 60, copy).lost
    late = np.random.default_rng(copy).integers(S // 5, 3 * S, 60)
    whole = Recording(np.arange(60) * S, lost, late)
    times, touch = in_touch(whole, D, 0.2)
    so_far = np.concatenate([[0.0], np.cumsum(np.diff(times) * touch)])
    none, late = np.zeros(60, bool), np.where(lost, 1000 * S, late)
    parts = [Recording(whole.sent_ns[:n], none[:n], late[:n]) for n in range(2, 61)]
    for part in (*parts, whole):
        bound = outage_verdict(part, proved(), 0.2).bound
        end = part.sent_ns[-1] / 1e9
        assert bound.touch_s == pytest.approx(np.interp(end, times, so_far), abs=1e-9)
        assert bound.touch_s + bound.out_s == pytest.approx(end)


def test_a_link_that_is_mostly_there_holds_and_one_that_is_mostly_gone_does_not() -> None:
    good, bad = (outage_verdict(recording(c), proved(), 0.1) for c in (MILD, BAD))
    assert good.holds
    assert good.bound.decays
    assert good.bound.guaranteed_share > 0.7
    assert not bad.holds
    assert bad.bound.share_had < bad.bound.share_needed
    assert bad.chain is not None
    assert bad.rates is not None
    assert not bad.rates.stable


def test_the_share_of_a_run_and_the_mean_square_are_two_things() -> None:
    """By its share the run is bounded; the chain is not shown stable by the rates."""
    chain = HiddenChain(np.array([[0.98, 0.02], [0.05, 0.95]]), np.array([0.0, 1.0]))
    found = outage_verdict(recording(chain, 2000, 1), proved(), 0.1)
    assert found.holds
    assert found.rates is not None
    assert found.jump is not None
    assert not found.rates.stable
    assert found.jump.stable
    assert found.jump.proved


@pytest.mark.parametrize("copy", sampled(range(12), 3))
def test_no_flight_over_a_recording_exceeds_its_bound(copy: int) -> None:
    """The loop itself, flown exactly over the recording: |x|_P^2 <= V(0) e^exponent at the end.

    And where the verdict holds, it comes to rest.
    """
    found, step = recording((MILD, BAD)[copy % 2], 600, copy), 0.1
    other = 0.1
    verdict = outage_verdict(found, proved(), other)
    outages = proved().guarantees.outages
    assert outages is not None
    assert found.delay_ns is not None
    count = round(found.sent_ns[-1] / 1e9 / step)
    moved = scipy.linalg.expm(np.block([[AXIS.A, AXIS.B], [np.zeros((1, 3))]]) * step)[:2]
    x, seen = np.array([1.0, 0.5]), {}
    came = np.full(count + 5, -1)
    for k in np.flatnonzero(found.arrived):
        first = -(-int(found.sent_ns[k] + found.delay_ns[k]) // round(step * 1e9))
        came[min(first, count + 4)] = max(came[min(first, count + 4)], k)
    exactly = [outages.unknowns[name].tolist() for name in ("P", "S[0]")]
    P, S_ = (np.array([[float(y.p) / float(y.q) for y in row] for row in M]) for M in exactly)
    start = x @ (P + D * S_) @ x  # the kernel is at most one
    newest = -1
    for t in range(count):
        if t % round(1 / step) == 0:
            seen[t * round(step * 10) // 10] = x
        newest = max(newest, came[t])
        age = (t + 1) * step - newest if newest >= 0 else np.inf
        u = (K @ seen[newest])[0] if age <= D + 1e-9 else 0.0
        x = moved @ np.array([*x, u])
    # the receiver waits for its step: as `other` says, less touch than the recording has
    late = outage_verdict(found, proved(), other + step).bound.exponent
    assert x @ P @ x <= start * np.exp(max(late, verdict.bound.exponent)) * 1.01
    if verdict.holds:
        assert np.abs(x).max() < 1.0


def test_what_cannot_be_judged_is_refused_or_remarked() -> None:
    with pytest.raises(InputError, match="proves nothing across outages"):
        outage_verdict(recording(MILD), hinf.analyse(AXIS, K, order=0))
    with pytest.raises(InputError, match="nothing is left of the age"):
        outage_verdict(recording(MILD), proved(), 3.0)
    slow = Recording(np.arange(30) * 4 * S, np.arange(30) % 3 == 0, np.full(30, S // 4))
    found = outage_verdict(slow, proved())
    assert found.rates is None
    assert any("before the next one comes" in remark for remark in found.remarks)
    gone = Recording(np.arange(30) * S, np.ones(30, bool), np.full(30, S // 4))
    found = outage_verdict(gone, proved())
    assert found.chain is None
    assert (found.holds, found.bound.share_had) == (False, 0.0)


def test_the_verb_says_it_link_by_link(tmp_path: Path) -> None:
    write_recordings(tmp_path / "links.csv", {"good": recording(MILD), "bad": recording(BAD)})
    (tmp_path / "gain.json").write_text(json.dumps(proved().certificate), "utf-8")
    words = ("link", "verdict", "links.csv", "--design", "gain.json", "--other", "0.1")
    done = cosim(*words, "--json", cwd=tmp_path)
    assert done.code == 1
    links = json.loads(done.out)["links"]
    assert (links["good"]["holds"], links["bad"]["holds"]) == (True, False)
    own = outage_verdict(recording(MILD), proved(), 0.1)
    assert links["good"]["outages"]["share_had"] == pytest.approx(own.bound.share_had)
    text = " ".join(cosim(*words, "--node", "good", cwd=tmp_path).out.split())
    assert "holds" in text
    assert "gamma suspended from" in text
