"""A search for k1, k2 says how far it is, to whoever listens, and to nobody else."""

from __future__ import annotations

from cosim.core import report, reported_to
from cosim.hinf import design
from cosim.models import paper_example


def test_a_search_says_how_far_it_is() -> None:
    """The share grows with every solve, from zero and never beyond one."""
    heard: list[tuple[str, float]] = []
    with reported_to(lambda what, share: heard.append((what, share))):
        assert design(paper_example.system(), search=True, order=None).certified
    assert {what for what, _ in heard} == {"searching k1, k2"}
    shares = [share for _, share in heard]
    assert len(shares) > 5
    assert shares == sorted(shares)
    assert 0.0 == shares[0] < shares[-1] <= 1.0
    report("nobody listens", 0.5)
    assert len(heard) == len(shares)
