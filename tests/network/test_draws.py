"""Random draws: the published generator, and the declared distributions."""

from __future__ import annotations

import hashlib
import math
from fractions import Fraction
from typing import Any

import flint
import numpy as np
import pytest
from scipy import stats

from cosim.network import GilbertElliott, Jitter, LossChain, PacketLink, deliver, draws

MASK = 2**64 - 1


def philox(counter: list[int], key: list[int]) -> list[int]:
    """Philox 4x64-10 in plain integers, from the paper (Salmon et al. 2011, section 3.3)."""
    c, k = list(counter), list(key)
    for turn in range(10):
        if turn:
            k = [(k[0] + 0x9E3779B97F4A7C15) & MASK, (k[1] + 0xBB67AE8584CAA73B) & MASK]
        first, second = 0xD2E7470EE14C6C93 * c[0], 0xCA5A826395121157 * c[2]
        c = [
            (second >> 64) ^ c[1] ^ k[0],
            second & MASK,
            (first >> 64) ^ c[3] ^ k[1],
            first & MASK,
        ]
    return c


def raw_stream(seed: int, name: str, purpose: str, count: int, turn: int = 0) -> list[int]:
    """Return the stream as documented: key from SHA-256, counter from 1."""
    label = f"auv-cosim\0{seed}\0{name}\0{purpose}\0{turn}"
    digest = hashlib.sha256(label.encode()).digest()
    key = [int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")]
    blocks = [philox([i + 1, 0, 0, 0], key) for i in range(-(-count // 4))]
    return [word for block in blocks for word in block][:count]


def test_reference_is_philox() -> None:
    """The plain-integer Philox gives the known answer of the Random123 distribution."""
    assert philox([0, 0, 0, 0], [0, 0]) == [
        0x16554D9ECA36314C,
        0xDB20FE9D672D0FDC,
        0xD7E772CEE186176B,
        0x7E68B68AEC7BA23B,
    ]


@pytest.mark.parametrize(("seed", "name"), [(0, "a"), (7, "τ_sc"), (2**63 - 1, "long name/x.y")])
def test_uniform_is_the_documented_stream(seed: int, name: str) -> None:
    """Every double is the upper 53 bits of the documented Philox output."""
    expected = [(word >> 11) * 2.0**-53 for word in raw_stream(seed, name, "jitter", 41)]
    assert draws.uniform(seed, name, "jitter", 41).tolist() == expected


def test_uniform_jitter_exactly() -> None:
    """Uniform jitter is floor(width * 53 bits / 2**53) in exact arithmetic."""
    width = Jitter("uniform", width_ns=12_345_678)
    link = PacketLink("sc", 10**8, jitter=width, seed=5)
    words = raw_stream(5, "sc", "jitter", 101)
    expected = [math.floor(Fraction(word >> 11, 2**53) * 12_345_678) for word in words]
    when, sent, _, _ = deliver(link, 10**10 + 10**8 - 1).arrivals()
    assert (when - sent).tolist() == expected


def test_logarithm() -> None:
    """The logarithm is that of arbitrary-precision arithmetic to 2 ulp, also near 1 and 0."""
    x = np.concatenate(
        [
            draws.uniform(1, "x", "test", 2000),
            2.0 ** -np.arange(1, 54),
            1 - 2.0 ** -np.arange(2, 54),
        ]
    )
    x = x[x > 0]
    for value, got in zip(x.tolist(), draws.log(x).tolist(), strict=True):
        exact = flint.arb(value).log()
        assert abs(float((flint.arb(got) - exact).mid())) <= 2 * math.ulp(got)


@pytest.mark.parametrize(
    ("jitter", "law"),
    [
        (Jitter("uniform", width_ns=10**7), stats.uniform(0, 1e7)),
        (Jitter("exponential", mean_ns=10**6), stats.expon(0, 1e6)),
        (
            Jitter("exponential", mean_ns=10**6, max_ns=15 * 10**5),
            stats.truncexpon(1.5, scale=1e6),
        ),
        (Jitter("normal", sigma_ns=10**6), stats.halfnorm(0, 1e6)),
        (
            Jitter("normal", mean_ns=10**6, sigma_ns=10**6, max_ns=25 * 10**5),
            stats.truncnorm(-1.0, 1.5, loc=1e6, scale=1e6),
        ),
    ],
)
def test_jitter_distribution(jitter: Jitter, law: Any) -> None:
    """20 000 draws of each jitter pass Kolmogorov-Smirnov against SciPy's law."""
    extra = draws.jitter_ns(jitter, 3, "link", 20_000)
    assert stats.kstest(extra, law.cdf).pvalue > 1e-3
    assert extra.min() >= 0
    assert jitter.max_ns is None or extra.max() <= jitter.max_ns


def test_bernoulli_loss() -> None:
    """The number lost of 100 000 lies within five standard deviations of the binomial law."""
    lost = draws.lost(0.2, 1, "link", 100_000)
    assert abs(lost.sum() - 20_000) < 5 * math.sqrt(100_000 * 0.2 * 0.8)


def test_gilbert_elliott_loss() -> None:
    """Long-run loss and mean burst length are those of the Markov chain."""
    lost = draws.lost(GilbertElliott(0.05, 0.25), 1, "link", 200_000)
    assert lost.mean() == pytest.approx(0.05 / 0.30, rel=0.03)
    starts = np.flatnonzero(lost[1:] & ~lost[:-1]).size + int(lost[0])
    assert lost.sum() / starts == pytest.approx(4.0, rel=0.03)
    assert not lost[0]


def test_gilbert_elliott_with_equal_states_is_bernoulli() -> None:
    """If both states lose alike, the chain does not matter: the very same messages are lost."""
    chain = draws.lost(GilbertElliott(0.3, 0.4, 0.2, 0.2), 9, "link", 5000)
    assert (chain == draws.lost(0.2, 9, "link", 5000)).all()


@pytest.mark.parametrize("kind", ["exponential", "normal"])
def test_longer_run_begins_with_the_shorter(kind: str) -> None:
    """With truncation, too, the draws of one message do not depend on another's."""
    scale = {"exponential": {"mean_ns": 50}, "normal": {"sigma_ns": 50}}[kind]
    jitter = Jitter(kind, max_ns=60, **scale)
    short, long = (draws.jitter_ns(jitter, 1, "link", n) for n in (50, 500))
    assert (long[:50] == short).all()


JITTERS = [
    Jitter("uniform", width_ns=10**6),
    Jitter("exponential", mean_ns=50, max_ns=60),
    Jitter("normal", mean_ns=3, sigma_ns=50),
]


@pytest.mark.parametrize("first", [1, 3, 4, 5, 1000, 4097])
def test_a_block_has_its_part_of_the_stream(first: int) -> None:
    """Drawn from any message on, every draw is that of the whole run."""
    count, whole = 50, first + 50
    for draw in (
        lambda n, k: draws.uniform(3, "a", "test", n, first=k),
        lambda n, k: draws.lost(0.3, 3, "a", n, k),
        lambda n, k: draws.duplicated(0.3, 3, "a", n, k),
        *(lambda n, k, j=j: draws.jitter_ns(j, 3, "a", n, first=k) for j in JITTERS),
    ):
        assert draw(count, first).tolist() == draw(whole, 0)[first:].tolist()


@pytest.mark.parametrize("chain", [(0.3, 0.4), (0.9, 0.8), (0.0, 0.5), (1.0, 1.0)])
def test_bursts_go_on_from_block_to_block(chain: tuple[float, float]) -> None:
    """States drawn in blocks of any size, each told the last of the one before, are the run's."""
    burst = GilbertElliott(*chain)
    whole = draws.states(burst, 7, "a", 600)
    first = 0
    for count in (0, 1, 1, 2, 5, 91, 500):
        before = int(whole[first - 1]) if first else 0
        block = draws.states(burst, 7, "a", count, first, before=before)
        assert block.tolist() == whole[first : first + count].tolist()
        first += count


@pytest.mark.parametrize("p", [(0.3, 0.4, 0.1, 0.8), (0.9, 0.8, 0.0, 1.0), (0.0, 1.0, 0.5, 0.5)])
def test_a_chain_of_two_states_draws_what_bursts_draw(p: tuple[float, ...]) -> None:
    """Gilbert-Elliott is the chain of two states, draw by draw."""
    chain = LossChain(((1 - p[0], p[0]), (p[1], 1 - p[1])), (p[2], p[3]))
    bursts = draws.lost(GilbertElliott(*p), 3, "a", 2000)
    assert (draws.lost(chain, 3, "a", 2000) == bursts).all()


def test_what_is_impossible_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A draw of 0, the least there is, takes no way of probability 0."""
    monkeypatch.setattr(draws, "uniform", lambda *_, **__: np.zeros(5))
    never = LossChain(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 1.0, 1.0))
    assert draws.states(never, 1, "a", 5).tolist() == [0] * 5
    past = LossChain(((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 1.0, 1.0))
    assert draws.states(past, 1, "a", 5).tolist() == [0, 2, 2, 2, 2]


def test_a_chain_stays_as_long_as_it_says() -> None:
    """Shares of states, and of the messages lost, are those of the stationary distribution."""
    moves = ((0.9, 0.1, 0.0), (0.05, 0.9, 0.05), (0.0, 0.02, 0.98))
    chain = LossChain(moves, (0.0, 0.4, 1.0))
    share = np.bincount(draws.states(chain, 1, "a", 400_000), minlength=3) / 400_000
    # detailed balance: 0.1 a = 0.05 b, 0.05 b = 0.02 c
    exact = np.array([1.0, 2.0, 5.0]) / 8.0
    assert np.allclose(share, exact, atol=0.02)
    lost = draws.lost(chain, 1, "a", 400_000).mean()
    assert abs(lost - (0.4 * exact[1] + exact[2])) < 0.02
