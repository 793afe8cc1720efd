"""`DelayLTI`, a linear system with delays to compute with, and the functions that make one.

    from cosim.hinf.delay_lti import dead_time, lti
    L = 2 * lti(control.tf(1, [1, 1])) * dead_time(0.5)
    T = L.feedback()
    t, y = T.step_response()

Products, sums and feedback of such systems with each other and with models of python-control and
SciPy are exact: delays inside loops stay delays.
"""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError, NotAchievableError, Seconds, html_table, matrix_text, seconds
from cosim.hinf.delay_lti import to_models
from cosim.hinf.delay_lti.blocks import Blocks, Complexes, beside
from cosim.hinf.delay_lti.connections import dead, delays_of, in_series, with_io_delays
from cosim.hinf.delay_lti.frequency import (
    FrequencyResponse,
    Nyquist,
    frequency_response_of,
    nyquist_of,
)
from cosim.hinf.delay_lti.from_models import blocks_of
from cosim.hinf.delay_lti.margins import Margins, margins_of
from cosim.hinf.delay_lti.norm import NormResult, norm_of
from cosim.hinf.delay_lti.retarded import plain_of, terms_of
from cosim.hinf.delay_lti.root_array import CharacteristicRoots
from cosim.hinf.delay_lti.roots import is_stable, roots_of
from cosim.hinf.delay_lti.time_response import (
    TimeResponse,
    forced_response,
    impulse_response,
    initial_response,
    step_response,
)
from cosim.hinf.delay_lti.winding import winding_of
from cosim.models import Delay, DelaySystem


class DelayLTI(Blocks):
    """A linear time-invariant system with internal delays; made by `lti` and `dead_time`.

        >>> import control
        >>> from cosim.hinf import lti
        >>> from cosim.hinf.delay_lti import dead_time
        >>> loop = (2 * lti(control.tf(1, [1, 1])) * dead_time(0.5)).feedback()
        >>> loop
        <DelayLTI: 1 input, 1 output, 1 state, internal delays 0.5 s>
        >>> loop.is_stable(), round(loop.norm().value, 3)
        (True, 1.32)
        >>> loop.step_response([0, 1, 2]).outputs.shape
        (3,)

    `G2 * G1` is the series connection u -> G1 -> G2, `G1 + G2` the parallel one, `G.feedback(H)`
    the closed loop; `G.value(s)` its transfer function. Numbers, matrices, and models of
    python-control and SciPy may stand on either side. Matrices as in `cosim.hinf.delay_lti.blocks`.
    """

    __array_ufunc__ = None  # NumPy leaves matrix * system to the system
    __array_priority__ = 20  # and python-control as well

    @property
    def is_siso(self) -> bool:
        """Whether there is one input and one output."""
        return (self.inputs, self.outputs) == (1, 1)

    def __repr__(self) -> str:
        """Return one line: sizes and delays."""
        delays = sorted(set(self.delays.tolist()))
        kind = "neutral, " if self.is_neutral else ""
        listed = ", ".join(f"{d:.6g}" for d in delays[:6]) + (", ..." if len(delays) > 6 else "")
        counts = [(self.inputs, "input"), (self.outputs, "output"), (self.order, "state")]
        words = [f"{k} {what}{'' if k == 1 else 's'}" for k, what in counts]
        words.append(f"internal delays {listed} s" if delays else "no delay")
        return f"<DelayLTI: {kind}{', '.join(words)}>"

    def _repr_html_(self) -> str:
        """Return sizes and matrices, as notebooks show them."""
        return html_table(
            repr(self), {name: matrix_text(M) for name, M in self.matrices.items() if M.size}
        )

    # connections

    def __mul__(self, other: Any) -> DelayLTI:
        return series(other, self)

    def __rmul__(self, other: Any) -> DelayLTI:
        return series(self, other)

    __matmul__, __rmatmul__ = __mul__, __rmul__

    def __add__(self, other: Any) -> DelayLTI:
        return parallel(self, other)

    __radd__ = __add__

    def __neg__(self) -> DelayLTI:
        return _made(self.between(-np.eye(self.outputs), np.eye(self.inputs)))

    def __sub__(self, other: Any) -> DelayLTI:
        return parallel(self, -lti(other))

    def __rsub__(self, other: Any) -> DelayLTI:
        return parallel(other, -self)

    def __truediv__(self, other: float) -> DelayLTI:
        if not isinstance(other, numbers.Real):
            raise InputError(
                "a system can be divided by a number only",
                where="division",
                got=type(other).__name__,
                hint="L.feedback() is L / (1 + L)",
            )
        return series(self, 1.0 / float(other))

    def __getitem__(self, key: tuple[Any, Any]) -> DelayLTI:
        """Return the subsystem of these outputs and inputs."""
        rows, columns = (
            np.atleast_1d(np.arange(k)[i]) for k, i in zip(self.D.shape, key, strict=True)
        )
        return _made(self.between(np.eye(self.outputs)[rows], np.eye(self.inputs)[:, columns]))

    def feedback(self, other: Any = 1, sign: int = -1) -> DelayLTI:
        """Return the loop y = G (r + sign H y), G / (1 + G H) by default; see `feedback`."""
        return feedback(self, other, sign)

    # responses

    def value(self, s: ArrayLike) -> Any:
        """Return G(s), s.shape + (p, m); s.shape where there is one input and output.

        There is no call `G(s)`: python-control would take a callable system for an update function.

        Raises
        ------
        InputError : s is a pole.
        """
        try:
            value = self.at(s)
        except np.linalg.LinAlgError as error:
            raise InputError("a pole of the system", where="s", got=str(s)) from error
        return value[..., 0, 0][()] if self.is_siso else value

    def frequency_response(
        self,
        omega: ArrayLike | None = None,
        squeeze: None = None,  # noqa: ARG002 - `control.frequency_response` gives it
    ) -> FrequencyResponse:
        """Return G(j omega), exact at each frequency [rad/s]; None: a grid that shows it.

        Raises
        ------
        InputError : invalid frequencies, or the frequency of a pole.
        """
        return frequency_response_of(self, omega)

    def bode(self, omega: ArrayLike | None = None) -> FrequencyResponse:
        """Return the frequency response; of a loop with one input and output with its margins."""
        margins = None
        if self.is_siso:
            try:
                margins = margins_of(self)
            except NotAchievableError:  # a loop at the limit of stability, or not to be closed
                margins = None
        return frequency_response_of(self, omega, margins)

    def step_response(self, t: ArrayLike | None = None) -> TimeResponse:
        """Return the response to unit steps at t [s], an end, or until it has settled.

        Exact except for rounding, which `error` estimates.

        Raises
        ------
        InputError : invalid times, or times so long against the delays that memory does not
            suffice.
        """
        return step_response(self, t)

    def impulse_response(self, t: ArrayLike | None = None) -> TimeResponse:
        """Return the response to unit impulses; otherwise as `step_response`."""
        return impulse_response(self, t)

    def forced_response(
        self, t: ArrayLike, u: ArrayLike, *, hold: Literal["line", "constant"] = "line"
    ) -> TimeResponse:
        """Return the response to samples u (m, k) at t (k,), joined by lines or held.

        Raises
        ------
        InputError : times or values that do not fit.
        """
        return forced_response(self, t, u, hold=hold)

    def initial_response(
        self,
        x0: ArrayLike,
        t: ArrayLike | None = None,
        *,
        before: Literal["rest", "constant"] = "rest",
    ) -> TimeResponse:
        """Return the response from a state x0 (n,), at rest before 0 or constant.

        Raises
        ------
        InputError : a state or times that do not fit.
        """
        return initial_response(self, x0, t, before=before)

    # analysis

    def roots(self, count: int = 10) -> CharacteristicRoots:
        """Return the rightmost characteristic roots (poles) [1/s], counted: none is missing.

        Of a neutral system they are not counted.

        Raises
        ------
        InputError : `count` is less than 1.
        NotAchievableError : they cannot all be found.
        """
        return CharacteristicRoots(roots_of(self, count))

    def is_stable(self) -> bool:
        """Whether every characteristic root has a negative real part, and none come near the axis.

        Raises
        ------
        NotAchievableError : roots that cannot be found.
        """
        return is_stable(self)

    def norm(self) -> NormResult | None:
        """Return the H-infinity norm, its frequency and an upper bound; None: not stable.

        Raises
        ------
        NotAchievableError : characteristic roots that cannot be found.
        """
        return norm_of(self)

    def norm_proved(self) -> float | None:
        """Return a number just above the norm that is proved in ball arithmetic to be a bound.

        None: not stable, or no proof; see `analyse` for one with a certificate.
        """
        from cosim.hinf.delay_lti import norm_proved_of  # noqa: PLC0415 - ball arithmetic loads slowly

        norm = norm_of(self)
        return None if norm is None else norm_proved_of(self, norm)

    def margins(self) -> Margins:
        """Return gain, phase and delay margin of this loop, closed by u = r - L u.

        Raises
        ------
        InputError : more than one input or output.
        NotAchievableError : a loop at the limit of stability.
        """
        return margins_of(self)

    def nyquist(self, omega: ArrayLike | None = None) -> Nyquist:
        """Return the Nyquist curve of this loop, with the encirclements of -1 counted.

        Raises
        ------
        InputError : not as many inputs as outputs.
        NotAchievableError : a closed loop with roots on the axis, or infinitely many near it.
        """
        if self.inputs != self.outputs:
            raise InputError(
                "this is no loop",
                where="system",
                expected="as many inputs as outputs",
                got=f"{self.inputs} and {self.outputs}",
            )
        return nyquist_of(self, winding_of(self), omega)

    def system(self) -> DelaySystem:
        """Return a `DelaySystem` with the roots and the norm of this system, for proofs.

        It is this system without a delay that all inputs or all outputs share; or its transpose.

        Raises
        ------
        InputError : there is none: the system is neutral, or inputs and outputs have different
            delays.
        """
        plain = plain_of(self)
        retarded = None if plain is None or not self.order else plain.system()
        if retarded is None:
            raise InputError(
                "no DelaySystem has the response of this system",
                where="system",
                expected="states, and delays between them, or at all inputs or all outputs alike",
                hint="a filter before the late input or behind the late output gives it a state",
            )
        return retarded

    def plant(self) -> DelaySystem:
        """Return this system as a `DelaySystem` from u to z, for an FMU or a run.

        Raises
        ------
        InputError : a neutral system, no states, or delayed inputs or outputs: those are links.
        """
        first, *rest = terms_of(self)
        for term in rest:
            if term.B.any() or term.C.any() or term.D.any():
                raise InputError(
                    "the plant of this system has a dead time at its inputs or outputs",
                    where="plant",
                    expected="states, and delays between them alone",
                    got=f"{term.h:g} s",
                    hint="pack the part without it, and let a link carry the signal: "
                    f".link(NAME, kind='transport', delay={term.h:g})",
                )
        if not self.order:
            raise InputError(
                "a system without states is no plant",
                where="plant",
                got=repr(self)[1:-1],
                hint="a gain is a matrix, or the gain of a connection",
            )
        delays = [Delay(t.h, t.A) for t in rest]
        return DelaySystem(first.A, first.B, None, first.C, None, first.D, delays=delays)

    # other libraries; python-control asks the first four of a system that it does not know

    def isctime(self, strict: bool = False) -> bool:  # noqa: ARG002, FBT001, FBT002 - theirs
        """Whether its time is continuous: always."""
        return True

    def isdtime(self, strict: bool = False) -> bool:  # noqa: ARG002, FBT001, FBT002 - theirs
        """Whether its time is discrete: never."""
        return False

    def dcgain(self) -> Any:
        """Return G(0), as `value`; `InputError` for an integrator."""
        return self.value(0.0)

    def poles(self) -> Complexes:
        """Return the poles of a system without delays.

        Raises
        ------
        InputError : the system has delays, so infinitely many poles; `roots` finds the rightmost.
        """
        if self.delays.size:
            raise InputError(
                "a system with delays has infinitely many poles",
                where="poles",
                expected="a system without delays",
                got=repr(self)[1:-1],
                hint="roots(count) are the rightmost ones",
            )
        return np.linalg.eigvals(self.A).astype(np.complex128)

    def to_control(self, *, omega: ArrayLike | None = None, pade: int | None = None) -> Any:
        """Return a model of python-control: an exact `control.FRD`, or a `control.StateSpace`.

        Parameters
        ----------
        omega : frequencies [rad/s] of the FRD.
        pade : order of the Pade approximants in the state-space model, where there are delays.

        Raises
        ------
        InputError : python-control is not installed, or delays without either argument.
        """
        if omega is None:
            return to_models.state_space_for_control(self, pade)
        return to_models.to_control(self, omega)

    def to_scipy(self, *, pade: int | None = None) -> Any:
        """Return a `scipy.signal.StateSpace`, with Pade approximants where there are delays.

        Raises
        ------
        InputError : delays without `pade`.
        """
        return to_models.state_space_for_scipy(self, pade)

    def pade(self, order: int) -> DelayLTI:
        """Return the system with every delay replaced by its Pade approximant."""
        return _made(to_models.rational(self, order))


def lti(
    model: Any,
    *,
    input_delay: float | Sequence[float] = 0.0,
    output_delay: float | Sequence[float] = 0.0,
    io_delay: ArrayLike | None = None,
    gain: ArrayLike | None = None,
) -> DelayLTI:
    """Make a system with delays of a model, as MATLAB's tf(..., 'InputDelay', 2).

        >>> import control
        >>> from cosim.hinf import lti
        >>> lti(control.tf(1, [1, 2]), input_delay=2)
        <DelayLTI: 1 input, 1 output, 1 state, internal delays 2 s>
        >>> lti([[1, 0], [0, 3]], io_delay=[[1, 0], [0, 2]])
        <DelayLTI: 2 inputs, 2 outputs, 0 states, internal delays 1, 2 s>

    Parameters
    ----------
    model : a state-space model, transfer function or zeros, poles and gain of python-control or
        SciPy in continuous time; a number or matrix; a `DelaySystem` (inputs w, then u, which
        acts at once; output z), or a `ClosedLoop`.
    input_delay, output_delay : [s], one for all or one each.
    io_delay : (p, m) [s], one from each input to each output.
    gain : K of u = K x for a `DelaySystem`, which leaves w as input.

    Raises
    ------
    InputError : no such model, a discrete or improper one, delays that do not fit.
    """
    blocks = blocks_of(model, gain)
    if io_delay is not None:
        blocks = with_io_delays(blocks, io_delay)
    before = delays_of("input_delay", input_delay, blocks.inputs)
    after = delays_of("output_delay", output_delay, blocks.outputs)
    if any(before):
        blocks = series(beside(*(dead(d) for d in before)), blocks)
    if any(after):
        blocks = series(blocks, beside(*(dead(d) for d in after)))
    return _made(blocks)


def dead_time(tau: Seconds, size: int = 1) -> DelayLTI:
    """Return e^{-s tau}, the pure delay of `size` signals; tau in seconds, or with a unit.

        >>> import control
        >>> from cosim.hinf.delay_lti import dead_time
        >>> control.tf(1, [1, 1]) * dead_time("500 ms")
        <DelayLTI: 1 input, 1 output, 1 state, internal delays 0.5 s>
        >>> round(float(abs(dead_time(0.5).value(2j))), 3)  # it does not change the size
        1.0

    Raises
    ------
    InputError : tau is no number of seconds >= 0.
    """
    return _made(beside(*[dead(seconds(tau, "tau"))] * size))


def exp(exponent: Any) -> DelayLTI:
    """Return e^{-s tau} of the exponent -tau s, as of s = control.tf("s").

        >>> import control
        >>> from cosim.hinf.delay_lti import exp
        >>> s = control.tf("s")
        >>> 1 / (s + 1) * exp(-0.5 * s)
        <DelayLTI: 1 input, 1 output, 1 state, internal delays 0.5 s>

    Raises
    ------
    InputError : the exponent is no -tau s with tau >= 0.
    """
    try:
        top = np.trim_zeros(np.ravel(np.asarray(exponent.num, dtype=np.float64)), "f")
        bottom = np.trim_zeros(np.ravel(np.asarray(exponent.den, dtype=np.float64)), "f")
    except (AttributeError, ValueError) as error:
        raise InputError(
            "not an exponent of a delay",
            where="exp",
            expected="-tau * s with s = control.tf('s')",
            got=type(exponent).__name__,
            hint="dead_time(tau) is the same",
        ) from error
    if (
        bottom.size != 1
        or top.size not in (0, 2)
        or (top.size and (top[1] or top[0] / bottom[0] > 0))
    ):
        raise InputError(
            "not an exponent of a delay",
            where="exp",
            expected="-tau s with tau >= 0",
            got=f"{top.tolist()} over {bottom.tolist()}",
        )
    return dead_time(-float(top[0] / bottom[0]) if top.size else 0.0)


def series(*models: Any) -> DelayLTI:
    """Connect models in series, the first one first: series(G1, G2) is G2 * G1.

        >>> import control
        >>> from cosim.hinf.delay_lti import dead_time, series
        >>> late = series(control.tf(1, [1, 1]), dead_time(1), 2)
        >>> late, round(float(late.value(0).real), 3)
        (<DelayLTI: 1 input, 1 output, 1 state, internal delays 1 s>, 2.0)

    A model with one input and output is applied to each of any number of signals.

    Raises
    ------
    InputError : outputs and inputs that do not fit.
    """
    first, *rest = (blocks_of(model) for model in models)
    for following in rest:
        first = in_series(first, following)
    return _made(first)


def parallel(*models: Any) -> DelayLTI:
    """Add the outputs of models with the same inputs.

        >>> import control
        >>> from cosim.hinf.delay_lti import dead_time, parallel
        >>> both = parallel(control.tf(1, [1, 1]), dead_time(1))  # the same as with +
        >>> both, round(float(both.value(0).real), 3)
        (<DelayLTI: 1 input, 1 output, 1 state, internal delays 1 s>, 2.0)

    Raises
    ------
    InputError : sizes that do not fit.
    """
    all_blocks = [blocks_of(model) for model in models]
    shapes = {one.D.shape for one in all_blocks}
    p, m = max(shapes)
    all_blocks = [
        one.between(np.ones((p, 1)), np.ones((1, m))) if one.D.shape == (1, 1) else one
        for one in all_blocks
    ]
    if len({one.D.shape for one in all_blocks}) > 1:
        raise InputError(
            "models of different sizes cannot be added",
            where="parallel",
            expected=f"{p} outputs, {m} inputs",
            got=", ".join(f"{a} by {b}" for a, b in sorted(shapes)),
        )
    k = len(all_blocks)
    return _made(beside(*all_blocks).between(np.tile(np.eye(p), k), np.tile(np.eye(m), k).T))


def append(*models: Any) -> DelayLTI:
    """Put models beside each other, nothing connected: all inputs, all outputs.

        >>> import control
        >>> from cosim.hinf.delay_lti import append, dead_time
        >>> append(control.tf(1, [1, 1]), dead_time(1))
        <DelayLTI: 2 inputs, 2 outputs, 1 state, internal delays 1 s>

    models : as of `lti`.
    """
    return _made(beside(*(blocks_of(model) for model in models)))


def feedback(forward: Any, backward: Any = 1, sign: int = -1) -> DelayLTI:
    """Close the loop y = G (r + sign H y): from r to y.

        >>> import control
        >>> from cosim.hinf.delay_lti import dead_time, feedback
        >>> L = control.tf(2, [1, 1]) * dead_time(0.5)
        >>> feedback(L)  # L / (1 + L)
        <DelayLTI: 1 input, 1 output, 1 state, internal delays 0.5 s>
        >>> feedback(L).is_stable(), feedback(2 * L).is_stable()
        (True, False)
        >>> round(float(feedback(1, L).value(0).real), 3)  # 1 / (1 + L)
        0.333

    Parameters
    ----------
    forward, backward : G and H. A number H stands for that multiple of the identity.
    sign : -1, negative feedback, or 1.

    Raises
    ------
    InputError : sizes that do not fit, or direct terms that cancel in a loop without delay.
    """
    G = blocks_of(forward)
    H = blocks_of(backward)
    if H.D.shape == (1, 1) and G.D.shape != (1, 1) and G.inputs == G.outputs:
        H = beside(*[H] * G.outputs)
    if (H.inputs, H.outputs) != (G.outputs, G.inputs):
        raise InputError(
            "the feedback does not fit",
            where="feedback",
            expected=f"{G.outputs} inputs and {G.inputs} outputs",
            got=f"{H.inputs} inputs and {H.outputs} outputs",
        )
    if sign not in (1, -1):
        raise InputError("not a sign", where="sign", expected="1 or -1", got=str(sign))
    m, p = G.inputs, G.outputs
    F = np.zeros((m + p, p + m))
    F[:m, p:], F[m:, :p] = sign * np.eye(m), np.eye(p)
    loop = beside(G, H).closed(F)
    return _made(loop.between(np.eye(p, p + m), np.eye(m + p, m)))


def _made(blocks: Blocks) -> DelayLTI:
    return DelayLTI(**blocks.simplified().matrices)
