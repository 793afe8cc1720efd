"""Search k1, k2 with which a rate of decay can be proved of a given gain, and prove it."""

from __future__ import annotations

from cosim.hinf.certificate import Decay, growth_of, theorem_2_proof
from cosim.hinf.exact import exact
from cosim.hinf.lmi import (
    Answer,
    CornersProblem,
    not_found,
    solver_words,
    without_performance,
)
from cosim.hinf.synthesis.search import starts
from cosim.hinf.theorems import Scalars
from cosim.models import DelaySystem, Matrix

_DIGITS = 3  # of margins that are compared: those behind them may differ between machines


def corner_scalars(
    system: DelaySystem, rate: float, p: Scalars, gain: Matrix | None = None
) -> list[Scalars]:
    """Return k1, k2 feasible for the outermost corner alone: `p`, and the best fixed start."""
    outermost = CornersProblem(system, rate, outermost=True)
    corners: list[tuple[float, int, Scalars]] = []
    for at in starts(p):
        answer = outermost.margin(at, None, gain)
        if isinstance(answer, Answer) and answer.value > 0:
            corners.append((float(f"{-answer.value:.{_DIGITS}g}"), len(corners), at))
            if gain is not None and at is p:
                break
    likely = [at for _, _, at in sorted(corners)[:1]]
    return [p, *(at for at in likely if at is not p)] if any(x[2] is p for x in corners) else likely


def proved_decay(
    system: DelaySystem, gain: Matrix, rate: float, p: Scalars
) -> tuple[Decay | None, str]:
    """Prove that the loop decays at `rate`; return the proof, or None and why.

    Parameters
    ----------
    system, gain : the loop, with the deployed K.
    rate : [1/s].
    p : k1, k2 to try first.
    """
    growth = tuple(exact(value) for value in growth_of(system, rate))
    problem, bare = CornersProblem(system, rate), without_performance(system)
    reason = ""
    with solver_words() as words:
        for at in corner_scalars(system, rate, p, gain):
            near: Answer | None = None
            for _ in range(2):
                answer = problem.margin(at, None, gain, near)
                if not isinstance(answer, Answer) or answer.value <= 0:
                    break
                proof = theorem_2_proof(bare, gain, at.k1, at.k2, answer.unknowns)
                decay = Decay(exact(rate), growth, proof)
                failed = decay.failure(system, gain)
                if failed is None:
                    return decay, ""
                reason, near = failed, answer
    return None, reason or not_found(words)
