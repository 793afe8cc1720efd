"""Commands for gains and their proofs: design, analyse."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final, Literal

import typer

from cosim import hinf
from cosim.cli.arguments import (
    AUTO,
    gain_from,
    named_problem,
    numbers,
    order_of,
    with_weights,
    write,
    write_json,
)
from cosim.cli.common import (
    JsonOption,
    alternatives_named,
    answer,
    output_file,
    progress,
)
from cosim.cli.output_feedback import answer_output_feedback
from cosim.cli.result_json import result_json
from cosim.cli.result_view import result_view, verdict
from cosim.core import InputError, NotAchievableError
from cosim.models import DelaySystem

SaveNormOption = Annotated[
    Path | None,
    typer.Option(
        help="Write the proof of the upper bound of the exact norm to this file, if there is one.",
        callback=output_file,
    ),
]
SystemArgument = Annotated[
    str,
    typer.Argument(
        metavar="SYSTEM", help="paper, auv, the name of a scenario, or a system FILE.toml."
    ),
]
DelaysOption = Annotated[
    str | None,
    typer.Option(help="Delays in seconds, such as 0.5,1.25, instead of those of the system."),
]
LeastAgesOption = Annotated[
    str | None,
    typer.Option(
        help="Least age of each delay in seconds, such as 0,0.5: the proof then holds for "
        "ages between it and the delay, however they vary."
    ),
]
SampledOption = Annotated[
    bool,
    typer.Option(
        "--sampled",
        help="Assume that the age of the feedback grows at rate one, from its least age to "
        "at most its delay, until the next sample is used.",
    ),
]
DelayLimitOption = Annotated[float, typer.Option(help="Largest delay that is tried, in seconds.")]

DampingOption = Annotated[
    float | None,
    typer.Option(
        help="Least damping ratio, between 0 and 1, of every characteristic root s of the "
        "nominal loop with Re s >= -WITHIN (--within); no sector contains all roots "
        "of a loop with a delay."
    ),
]
WithinOption = Annotated[
    float | None,
    typer.Option(help="The roots that --damping is about: those with Re s >= -WITHIN, in 1/s."),
]
MeasuredOption = Annotated[
    str | None,
    typer.Option(
        help="Numbers of the states that are fed back, counted from 1; K is zero for the others."
    ),
]
IntegralOption = Annotated[
    str | None,
    typer.Option(
        help="Numbers of the states with integral action, counted from 1: the controller "
        "integrates them as it receives them."
    ),
]
IntegralWeightsOption = Annotated[
    str | None,
    typer.Option(
        help="Weights of the integrals in z, one number or one for each (default: 0.1/d "
        "times those of their states, where d is the delay of the feedback)."
    ),
]
IntegralAgeOption = Annotated[
    float | None,
    typer.Option(
        help="Greatest age of an integral when it acts, in seconds; 0: it acts at once "
        "(default: the age of the feedback where that varies, otherwise 0)."
    ),
]

OutagesOption = Annotated[
    bool,
    typer.Option(
        "--outages",
        help="Also prove bounds across outages of the link, in which zero input takes over "
        "by the age designed for: rates with the link up and in outages, and the "
        "share of the time that the link must be up.",
    ),
]

THEOREM_2: Final = "theorem-2"


class Solver(StrEnum):
    """Values of --solver."""

    CLARABEL = "clarabel"
    CVXPY = "cvxpy"


def design(
    name: SystemArgument,
    k1: Annotated[
        str | None, typer.Option(help="Free scalars k1 of Theorem 2, one per delay: -0.3,-1.0.")
    ] = None,
    k2: Annotated[
        str | None, typer.Option(help="Free scalars k2 of Theorem 2, one per delay.")
    ] = None,
    gamma: Annotated[
        float | None, typer.Option(help="Meet this gamma instead of finding the least one.")
    ] = None,
    search: Annotated[
        bool,
        typer.Option(
            "--search", help="Search for better k1, k2, starting from the given ones and others."
        ),
    ] = False,
    order: Annotated[
        str,
        typer.Option(
            help="auto: try every condition and claim the best proof; theorem-2: Theorem 2 alone; "
            "N: improve the gain of Theorem 2 with the Bessel-Legendre inequality of order N. From "
            "order 1 on the proof is for exactly these delays; the output says whether it also "
            "covers all smaller ones."
        ),
    ] = AUTO,
    solver: Annotated[
        Solver,
        typer.Option(help="cvxpy: solve the plain LMI of Theorem 2 with cvxpy and Clarabel."),
    ] = Solver.CLARABEL,
    delays: DelaysOption = None,
    least_ages: LeastAgesOption = None,
    sampled: SampledOption = False,
    max_delay: Annotated[
        bool,
        typer.Option(
            "--max-delay",
            help="Find the greatest delay of the feedback, or else the greatest first "
            "delay, at which gamma is certified.",
        ),
    ] = False,
    delay_limit: DelayLimitOption = hinf.problem.DELAY_LIMIT,
    price: Annotated[
        bool,
        typer.Option(
            "--uncertainty-price",
            help="Also certify this gain without uncertainty, to show how much of gamma "
            "the uncertainty causes.",
        ),
    ] = False,
    decay: Annotated[
        float | None,
        typer.Option(help="Least rate of decay of every solution with w = 0, in 1/s."),
    ] = None,
    damping: DampingOption = None,
    within: WithinOption = None,
    gain_limit: Annotated[
        float | None, typer.Option(help="Bound on |K|, the largest singular value of K.")
    ] = None,
    peak_control: Annotated[
        str | None,
        typer.Option(
            help="Bounds on |u_i(t)|, one number or one per input, for --offset and --energy."
        ),
    ] = None,
    offset: Annotated[
        str | None,
        typer.Option(
            help="Bounds on the initial state |x_i(0)|, one per state; x is constant for t < 0."
        ),
    ] = None,
    energy: Annotated[
        float | None,
        typer.Option(help="Bound on the disturbance: square root of the integral of w'w."),
    ] = None,
    weights: Annotated[
        str | None, typer.Option(help="Weights of the rows of z, instead of those of the system.")
    ] = None,
    measured: MeasuredOption = None,
    integral: IntegralOption = None,
    integral_weights: IntegralWeightsOption = None,
    integral_age: IntegralAgeOption = None,
    outages: OutagesOption = False,
    save: Annotated[
        Path | None,
        typer.Option(
            help="Write the design and its exact certificate to this file.", callback=output_file
        ),
    ] = None,
    save_norm: SaveNormOption = None,
    save_refutation: Annotated[
        Path | None,
        typer.Option(
            help="Write the proof that no solution exists to this file, if there is one.",
            callback=output_file,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Design an H-infinity state feedback for a system with delays, and prove it exactly.

    gamma bounds the gain from w to z for every admissible uncertainty. It is certified in
    rational arithmetic for the gain that is printed and saved. The exact norm and the abscissa
    of the nominal loop are shown beside it. If neither the system nor the command line gives k1 and
    k2, they are searched for. If no proof is found, other conditions are tried; the best proof is
    claimed. The same certificate proves the design constraints --decay, --damping with --within,
    --gain-limit, and --peak-control with --offset or --energy.

    If the file has [[measurements]] that need an observer, the observer's injections are designed
    with the gain, and both are certified together.

    Exit code 5: the design cannot be achieved. If that is proved, --save-refutation saves the
    proof.

    \b
    cosim design paper --k1 0.6 --k2 0.2 --save gain.json
    cosim design my-system.toml --search --json
    cosim design paper --gamma 6 --max-delay --search
    cosim design paper --decay 4 --gain-limit 2
    cosim design my-system.toml --outages --json
    """
    options = dict(locals())
    named, gain = named_problem(name)
    if named.observer is not None:
        answer_output_feedback(named, options, order_of(order, AUTO, THEOREM_2))
        return
    if weights is not None:
        named = with_weights(named, numbers("--weights", weights))
    system = _at_delays(named.system, delays, least_ages, sampled=sampled)
    if measured is not None or integral is not None:
        system = _with_structure(system, measured, integral, integral_weights, integral_age)
        # those of the system are for feedback of the whole state
        named = replace(named, k1=None, k2=None)
    scalars = (
        named.k1 if k1 is None else numbers("--k1", k1),
        named.k2 if k2 is None else numbers("--k2", k2),
    )
    asked = {
        "decay": decay,
        "damping": damping,
        "within": within,
        "gain_limit": gain_limit,
        "peak_control": None if peak_control is None else numbers("--peak-control", peak_control),
        "offset": None if offset is None else numbers("--offset", offset),
        "energy": energy,
    }
    design_constraints = asdict(named.design_constraints) | {
        k: v for k, v in asked.items() if v is not None
    }
    goal = named.gamma if gamma is None else gamma
    condition = order_of(order, AUTO, THEOREM_2)
    greatest: hinf.GreatestDelay | None = None
    # those of integrals are no numbers of --delays
    other_delays = "--delays" if integral is None else None
    with (
        progress() as report_progress,
        _refutation_saved(save_refutation),
        alternatives_named(other_delays),
    ):
        report_progress(f"design of {name}", 0.0)
        if max_delay:
            if gain is not None:
                raise InputError(
                    "this scenario gives its gain, but --max-delay designs one",
                    where="--max-delay",
                )
            if any(value is not None for value in design_constraints.values()):
                raise InputError(
                    "the greatest delay can be found for gamma alone",
                    where="--max-delay",
                    expected="no decay, damping, gain limit or peak of the control",
                    hint="try them at a given delay: --delays",
                )
            greatest = hinf.greatest_delay(
                system,
                goal,
                *scalars,
                delay_index=_varied_delay(system),
                limit=delay_limit,
                search=search or None,
                order=condition,
            )
            found = greatest.result
        else:
            found = hinf.design(
                system,
                *scalars,
                gamma=goal,
                gain=gain,
                search=search or None,
                order=condition,
                solver=solver.value,
                **design_constraints,
            )
        if outages:
            found = hinf.synthesis.with_outages(found)
        nominal = hinf.synthesis.nominal_gamma(found) if price else None
    if save is not None:
        write(save, found.file_text())
    refutation = None if greatest is None else greatest.refutation
    kept = None if refutation is None else save_refutation
    if kept is not None:
        write_json(kept, refutation)
    norm_file = _save_norm(save_norm, found)
    has_limit = found.guarantees.gain_limit is not None
    remark = None if has_limit else hinf.synthesis.gain_remark(found.system, found.K)
    answer(
        as_json,
        lambda: (
            result_json(name, found, save, greatest, nominal)
            | {
                "weights": None if named.weights is None else list(named.weights),
                "refutation": None if kept is None else str(kept),
                "remark": remark,
                "norm_certificate": norm_file,
            }
        ),
        lambda: result_view(name, found, greatest, nominal, remark),
        **verdict(name, found, save, greatest),
    )


def _at_delays(
    system: DelaySystem, delays: str | None, least_ages: str | None, *, sampled: bool
) -> DelaySystem:
    """Return the system with the delays and ages of the command line."""
    if delays is not None:
        system = hinf.problem.with_delays(system, numbers("--delays", delays))
    if least_ages is not None or sampled:
        least = None if least_ages is None else numbers("--least-ages", least_ages)
        system = hinf.problem.with_ages(system, least, sampled=sampled)
    return system


def _with_structure(
    system: DelaySystem,
    measured: str | None,
    integral: str | None,
    weights: str | None,
    age: float | None,
) -> DelaySystem:
    """Return the system with the feedback that --measured and --integral ask for."""
    if measured is not None:
        states = hinf.problem.states_of(numbers("--measured", measured), "--measured")
        system = hinf.problem.with_measured(system, states)
    if integral is not None:
        states = hinf.problem.states_of(numbers("--integral", integral), "--integral")
        own = None if weights is None else numbers("--integral-weights", weights)
        system = hinf.problem.with_integral(system, states, weights=own, age=age)
    return system


@contextmanager
def _refutation_saved(path: Path | None) -> Iterator[None]:
    """Save the proof that a design cannot be achieved, if there is one, and name it in the hint."""
    try:
        yield
    except NotAchievableError as error:
        if error.certificate is not None:
            next_step = "--save-refutation FILE saves the proof"
            if path is not None:
                write_json(path, error.certificate)
                next_step = f"check the proof: cosim certificate check {path}"
            error.hint = next_step if error.hint is None else f"{error.hint}; {next_step}"
        raise


def _save_norm(path: Path | None, found: hinf.Result) -> str | None:
    """Write the proof of the upper bound of the nominal norm; return where, None without one."""
    if path is None or found.exact_norm_upper is None:
        return None
    proof = hinf.delay_lti.norm_certificate(found.system, found.K, found.exact_norm_upper)
    if proof is None:
        return None
    write_json(path, proof)
    return str(path)


def _varied_delay(system: DelaySystem) -> int:
    """Return the index of the delay that `--max-delay` varies: of the feedback, else the first."""
    return next((j for j, delay in enumerate(system.delays) if delay.feedback), 0)


def analyse(
    name: SystemArgument,
    gain: Annotated[
        str | None,
        typer.Option(
            help='The gain K as rows: "[[0.6, -0.5]]" (default: the scenario\'s, or none).'
        ),
    ] = None,
    order: Annotated[
        str,
        typer.Option(
            help="auto: the best proof of the conditions that take a few seconds; 0: Theorem 1; N: "
            "the less conservative Bessel-Legendre condition of order N."
        ),
    ] = AUTO,
    gamma: Annotated[
        float | None, typer.Option(help="Prove this gamma instead of finding the least one.")
    ] = None,
    delays: DelaysOption = None,
    least_ages: LeastAgesOption = None,
    sampled: SampledOption = False,
    max_delay: Annotated[
        bool,
        typer.Option(
            "--max-delay",
            help="Find the greatest delay of the feedback, or else the greatest first "
            "delay, at which stability, or --gamma, is certified.",
        ),
    ] = False,
    delay_limit: DelayLimitOption = hinf.problem.DELAY_LIMIT,
    damping: DampingOption = None,
    within: WithinOption = None,
    outages: OutagesOption = False,
    save: Annotated[
        Path | None,
        typer.Option(
            help="Write the exact certificate to this file, if there is one.", callback=output_file
        ),
    ] = None,
    save_norm: SaveNormOption = None,
    as_json: JsonOption = False,
) -> None:
    """Analyse the loop with a given gain, or the system without control, and prove the result.

    The result is the least gamma that can be certified for every admissible uncertainty, or
    stability if the system has no w or no z. The verdict is "certified", "unstable" (a root of the
    nominal loop is proved to have a positive real part) or "undecided": a bound that is not
    certified may still hold, and a root on the imaginary axis proves neither. With --damping, the
    result also says whether the damping is proved.

    Exit code 0: there is a verdict, whatever it is; 2: bad input.

    \b
    cosim analyse paper --gain "[[0.6432, -0.5679]]"
    cosim analyse my-system.toml --save proof.json
    """
    options = dict(locals())
    named, own_gain = named_problem(name)
    if named.observer is not None:
        if named.observer.gain is None or named.observer.injections is None:
            raise InputError(
                "an observer is analysed with its gains",
                where=f"{name}: observer",
                expected="K and L in [observer]",
                hint="cosim design finds them",
            )
        answer_output_feedback(named, options, order_of(order, AUTO))
        return
    system = _at_delays(named.system, delays, least_ages, sampled=sampled)
    K = own_gain if gain is None else gain_from(gain)
    condition = order_of(order, AUTO) or 0  # never None: Theorem 2 is no word here
    greatest: hinf.GreatestDelay | None = None
    with progress() as report_progress:
        report_progress(f"analysis of {name}", 0.0)
        if max_delay:
            if damping is not None or within is not None:
                raise InputError(
                    "the greatest delay can be found for gamma or stability alone",
                    where="--max-delay",
                    expected="no damping",
                    hint="try it at a given delay: --delays",
                )
            varied = _varied_delay(system)
            greatest = hinf.certified_delay(
                system, K, gamma, delay_index=varied, order=condition, limit=delay_limit
            )
            found = greatest.result
        else:
            found = hinf.analyse(system, K, gamma, order=condition, damping=damping, within=within)
        if outages and found.certified:
            found = hinf.synthesis.with_outages(found)
        hint = None if found.certified else _instead(found, gamma, condition)
    saved = save if found.certified else None
    if saved is not None:
        write_json(saved, found.certificate)
    norm_file = _save_norm(save_norm, found)
    answer(
        as_json,
        lambda: (
            result_json(name, found, saved, greatest)
            | {"norm_certificate": norm_file, "hint": hint}
        ),
        lambda: result_view(name, found, greatest, hint=hint),
        **verdict(name, found, saved, greatest),
    )


def _instead(
    undecided: hinf.Result, gamma: float | None, order: int | Literal["auto"]
) -> str | None:
    """Return what can be certified of a gain that is not as it was asked, with the options."""
    refused = hinf.synthesis.with_alternatives_to(undecided, gamma, order)
    with suppress(NotAchievableError), alternatives_named("--delays"):
        raise refused
    return refused.hint
