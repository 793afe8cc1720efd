"""Models of other libraries as blocks: python-control, SciPy, NumPy, and this package's own.

Nothing is imported for it: what counts is A, B, C, D, or num and den, in continuous time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf.delay_lti.blocks import Blocks, Reals, beside, blocks_from
from cosim.hinf.delay_lti.closed_loop import ClosedLoop, close
from cosim.models import DelaySystem

_EXPECTED = (
    "a state-space model or a transfer function of python-control or SciPy, a number, a matrix, "
    "a DelaySystem or a ClosedLoop"
)


def blocks_of(model: Any, gain: ArrayLike | None = None) -> Blocks:
    """Return the blocks of any model in continuous time; see `lti`.

    Raises
    ------
    InputError : none of these, a discrete or an improper model.
    """
    if isinstance(model, Blocks):
        return model
    if isinstance(model, DelaySystem):
        return _of_system(model) if gain is None else _of_loop(close(model, gain))
    if isinstance(model, ClosedLoop):
        return _of_loop(model)
    _refuse_discrete(model)
    try:
        return _of_foreign(model)
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise InputError(
            "not a model of a linear system",
            where="model",
            expected=_EXPECTED,
            got=type(model).__name__,
        ) from error


def _of_foreign(model: Any) -> Blocks:
    if all(hasattr(model, name) for name in "ABCD"):
        return _of_state_space(*(np.asarray(getattr(model, name)) for name in "ABCD"))
    if hasattr(model, "num") and hasattr(model, "den"):
        return _of_transfer_function(model.num, model.den)
    if hasattr(model, "zeros") and hasattr(model, "gain"):
        return _of_foreign(model.to_tf())
    static = np.atleast_2d(np.asarray(model, dtype=np.float64))
    return _of_state_space(np.zeros((0, 0)), np.zeros((0, static.shape[1])), None, static)


def _refuse_discrete(model: Any) -> None:
    dt = getattr(model, "dt", None)
    if dt is True or dt:
        raise InputError(
            "a discrete model",
            where="model",
            expected="continuous time",
            got="an unspecified step" if dt is True else f"dt = {dt:g} s",
        )


def _of_state_space(A: Reals, B: Reals, C: Reals | None, D: Reals) -> Blocks:
    n, (p, m) = A.shape[0], D.shape
    C = np.zeros((p, n)) if C is None else C
    return blocks_from({"A": A, "B": B, "C": C, "D": D}, (n, m, p), "model")


def _of_loop(loop: ClosedLoop) -> Blocks:
    """w -> z of a closed loop, every state late on a channel of its own where it is used late."""
    n = loop.order
    delayed = [
        (d, A, loop.D[i] if loop.D else np.zeros((0, n)))
        for i, (d, A) in enumerate(zip(loop.delays, loop.A, strict=True))
        if d > 0.0
    ]
    C = np.zeros((n, 0)) if loop.C is None else np.asarray(loop.C)
    D = loop.D[0] if loop.D else np.zeros((0, n))
    D1 = np.zeros((0, 0)) if loop.D1 is None else np.asarray(loop.D1)
    given: dict[str, Any] = {"A": loop.A[0], "B": C, "C": D, "D": D1}
    given |= _channels(n, delayed)
    return blocks_from(given, (n, C.shape[1], D.shape[0]), "loop")


def _of_system(system: DelaySystem) -> Blocks:
    """[w, u] -> z of a system with delays; u acts at once, since its delay is the feedback's."""
    n, p = system.A.shape[0], system.D.shape[0]
    delayed = [(x.constant_age, x.A, np.zeros((p, n))) for x in system.delays]
    given: dict[str, Any] = {"A": system.A, "B": np.hstack([system.C, system.B]), "C": system.D}
    given |= {"D": np.hstack([system.D1, system.D2]), **_channels(n, delayed)}
    return blocks_from(given, (n, given["B"].shape[1], p), system.name or "system")


def _channels(n: int, delayed: Sequence[tuple[float, Reals, Reals]]) -> dict[str, Any]:
    """Return the channels of terms A_i x(t-d_i), D_i x(t-d_i): one per state that is used."""
    Bw, Dw, Cv, delays = [], [], [], []
    for d, A, D in delayed:
        stacked = np.vstack([A, D])
        # of low rank, as a feedback is, fewer signals than states are late
        left, sizes, right = np.linalg.svd(stacked, full_matrices=False)
        rank = int((sizes > 1e-15 * stacked.size * sizes.max(initial=0.0)).sum())
        used = np.flatnonzero(stacked.any(axis=0))
        if rank == 1 < used.size:
            into, out = right[:1], left[:, :1] * sizes[:1]
        else:
            into, out = np.eye(n)[used], stacked[:, used]
        Bw.append(out[:n])
        Dw.append(out[n:])
        Cv.append(into)
        delays += [d] * len(into)
    if not delayed:
        return {}
    return {"Bw": np.hstack(Bw), "Dw": np.hstack(Dw), "Cv": np.vstack(Cv), "delays": delays}


def _of_transfer_function(num: Any, den: Any) -> Blocks:
    """Realise numerators over denominators: SISO, SciPy's single-input, or [i][j] of MIMO."""
    if np.ndim(den) == 1 and not _is_nested(den):
        rows = np.atleast_2d(np.asarray(num, dtype=np.float64))
        tops = [[row] for row in rows]
        bottoms = [[np.asarray(den, dtype=np.float64)] for _ in rows]
    else:
        tops = [[np.asarray(x, dtype=np.float64) for x in row] for row in num]
        bottoms = [[np.asarray(x, dtype=np.float64) for x in row] for row in den]
    by_columns = _realised(tops, bottoms)
    turned = [[list(row) for row in zip(*rows, strict=True)] for rows in (tops, bottoms)]
    by_rows = _realised(turned[0], turned[1])
    # states that outputs share, or that inputs share, whichever are fewer
    return by_columns if by_columns.order <= by_rows.order else by_rows.transposed()


def _realised(tops: list[list[Reals]], bottoms: list[list[Reals]]) -> Blocks:
    p, m = len(tops), len(tops[0])
    columns = [
        _column([tops[i][j] for i in range(p)], [bottoms[i][j] for i in range(p)], j)
        for j in range(m)
    ]
    return beside(*columns).between(np.tile(np.eye(p), m), np.eye(m))


def _is_nested(den: Any) -> bool:
    return isinstance(den, list | np.ndarray) and len(den) > 0 and np.ndim(den[0]) > 0


def _column(tops: list[Reals], bottoms: list[Reals], j: int) -> Blocks:
    """Realise one input: outputs over the same denominator share their states."""
    parts: list[Blocks] = []
    places: list[list[int]] = []
    left = list(range(len(tops)))
    for i, (top, bottom) in enumerate(zip(tops, bottoms, strict=True)):
        _check_proper(top, bottom, f"model[{i}][{j}]")
    while left:
        denominator = _monic(tops[left[0]], bottoms[left[0]])[1]
        same = [i for i in left if np.array_equal(_monic(tops[i], bottoms[i])[1], denominator)]
        rows = [_monic(tops[i], bottoms[i])[0] for i in same]
        parts.append(_canonical_form(rows, denominator))
        places.append(same)
        left = [i for i in left if i not in same]
    order = np.concatenate(places)
    joined = beside(*parts)
    sort = np.zeros((len(tops), len(tops)))
    sort[order, np.arange(len(tops))] = 1.0
    return joined.between(sort, np.ones((len(parts), 1)))


def _monic(top: Reals, bottom: Reals) -> tuple[Reals, Reals]:
    """Return numerator and denominator without leading zeros, the denominator monic."""
    bottom = np.trim_zeros(bottom, "f")
    return np.trim_zeros(top, "f") / bottom[0], bottom / bottom[0]


def _check_proper(top: Reals, bottom: Reals, where: str) -> None:
    numerator, denominator = np.trim_zeros(top, "f"), np.trim_zeros(bottom, "f")
    if not denominator.size or not np.isfinite(np.concatenate([top, bottom])).all():
        raise InputError("not a transfer function", where=where, expected="a finite denominator")
    if numerator.size > denominator.size:
        raise InputError(
            "an improper transfer function has no step response",
            where=where,
            expected=f"a numerator of degree {denominator.size - 1} at most",
            got=f"degree {numerator.size - 1}",
            hint="put a fast pole beside a derivative: s / (0.01 s + 1)",
        )


def _canonical_form(tops: list[Reals], bottom: Reals) -> Blocks:
    """Realise numerators over one monic denominator, in balanced units."""
    n = bottom.size - 1
    padded = np.array([np.concatenate([np.zeros(n + 1 - top.size), top]) for top in tops])
    D = padded[:, :1]
    A = np.eye(n, k=-1)
    B = np.zeros((n, 1))
    C = padded[:, 1:] - D * bottom[1:]
    if n:
        A[0] = -bottom[1:]
        B[0] = 1.0
        scale = np.asarray(scipy.linalg.matrix_balance(A, permute=False, separate=True)[1][0])
        A, B, C = A * scale[None, :] / scale[:, None], B / scale[:, None], C * scale[None, :]
    return _of_state_space(A, B, C, D)
