"""A result: what is certified of a loop, with its proof and the figures of its nominal loop.

Designs, analyses and output feedbacks are results alike: a gain, its bound, and the certificate
that holds them. It stands apart from what makes one: a run reads a result, and loads no solver for
that.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np

from cosim.core import (
    DESIGN_FILE,
    AnyPath,
    InputError,
    format_value,
    html_table,
    matrix_text,
    not_written,
    write_whole,
)
from cosim.hinf import delay_lti
from cosim.hinf.certificate import (
    KEY,
    Certificate,
    CertificateCheck,
    Guarantees,
    ObserverPair,
    check_certificate,
    covers_smaller,
    differences,
    gain_from_json,
    guarantees_from_json,
    pair_from_json,
    read_certificate,
    system_from_json,
)
from cosim.hinf.synthesis.figures_json import (
    FIGURES,
    LATER_FIGURES,
    figures_from_json,
    figures_to_json,
    has_figures,
)
from cosim.models import DelaySystem, Matrix, Measurement, Value

_OF_A_GAIN = ("kind", "theorem", "claim", "system", "variables", "K", KEY)
"""What is kept of a file about a gain: its proof, and no note beside it."""


@dataclass(frozen=True, eq=False, repr=False)
class Result(delay_lti.HasFigures, Value):
    """A loop with its certified bounds, their proof, and the figures of its nominal loop.

        >>> from cosim import DelaySystem, Result, design, link
        >>> system = DelaySystem(
        ...     A=[[0.1]], B=[[1]], C=[[1]], D=[[1], [0]], D2=[[0], [1]], delays=[link(0.5)]
        ... )
        >>> found = design(system)
        >>> found.certified, found.K.shape, found.gamma < 1.6, found.abscissa < 0
        (True, (1, 1), True, True)
        >>> Result.load(found.save("gain.json")) == found  # its proof is checked again
        True

    A result cannot be changed, and two results are equal if all their contents are. For another
    gain, `analyse` gives another result.

    Attributes
    ----------
    system : the system (n states, m controls); with an observer the plant.
    K : (m, n) the gain, as its doubles; zero for u = 0.
    gamma : certified bound of the gain from w to z, uncertainty included; with an observer from
        (w, w_1 .. w_p). None where there is no w or no z and stability alone is certified, or
        nothing.
    figures : of the nominal loop; None for an older file without them. They are also attributes of
        the result: `abscissa`, `exact_norm`, `exact_norm_upper`, `norm_frequency`, `delay_margin`
        and `worst_case` (see `NominalFigures`).
    certificate : the proof as JSON values, for `check_certificate`; None where nothing is proved.
    order : Bessel-Legendre order of the proof, 0 for Theorem 1; None for Theorem 2.
    k1, k2 : of Theorem 2, one per delay; empty where the proof has an `order`.
    least_gamma : the solver's least gamma: not a proof; None where it finds none.
    guarantees : the design constraints and bounds proved beside gamma, also in the certificate.
    observer : plant and observer as one system, which the proof is about; None where the state is
        fed back.
    reason : why nothing is proved; None if something is.
    damping_reason : why the damping that was asked for is not proved; None if it is, or none was.

    Raises
    ------
    InputError : made with a system, gain, bound, guarantee or observer that is not the
        certificate's.
    """

    system: DelaySystem
    K: Matrix
    gamma: float | None
    figures: delay_lti.NominalFigures
    certificate: Any
    order: int | None = None
    k1: tuple[float, ...] = ()
    k2: tuple[float, ...] = ()
    least_gamma: float | None = None
    guarantees: Guarantees = field(default_factory=Guarantees)
    observer: ObserverPair | None = None
    reason: str | None = None
    damping_reason: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.certificate is None) != (self.reason is not None):
            raise InputError(
                "what is said is not what is proved",
                where="certificate",
                expected="a certificate where something is proved, a reason where nothing is",
                got="neither" if self.reason is None else "both",
            )
        if self.certificate is None:
            return
        object.__setattr__(self, "certificate", Certificate(self.certificate))
        for first in self._unlike(proved_facts(self.certificate)):
            raise InputError(
                "what is said is not what is proved",
                where="the certificate of this result",
                expected="the system, the gain and the bound of the proof",
                got=first,
                hint="analyse(system, K) proves another gain; Result.load reads a design again",
            )

    def _unlike(self, proved: Mapping[str, Any]) -> Iterator[str]:
        """Yield where this says another thing than its certificate.

        A proof is about the doubles that it names: `dataclasses.replace(design, K=...)` would put
        another gain beside it.
        """
        system, K = proved["system"], proved["K"]
        apart = [f"system: {one}" for one in differences(self.system, system)]
        if apart:
            yield apart[0]
            return
        if self.K.shape != K.shape:
            yield f"K: shape {self.K.shape} and {K.shape}"
            return
        for i, j in np.argwhere(self.K != K).tolist():
            yield f"K[{i + 1},{j + 1}]: {float(self.K[i, j])!r} and {float(K[i, j])!r}"
        for name in ("gamma", "order", "k1", "k2"):
            if getattr(self, name) != proved[name]:
                yield f"{name}: {getattr(self, name)!r} and {proved[name]!r}"
        if self.observer != proved["observer"]:
            yield "a pair of another plant, measurement, K or L"
        if self.guarantees != proved["guarantees"]:
            yield f"{self.guarantees!r}, and {proved['guarantees']!r}"

    @cached_property
    def _checked(self) -> CertificateCheck:
        return check_certificate(self.certificate)

    @property
    def certified(self) -> bool:
        """Whether the proof holds; checked here, once: no certificate is trusted unchecked."""
        return self.certificate is not None and self._checked.valid

    @property
    def covers_smaller_delays(self) -> bool:
        """Whether the proof covers every delay up to the system's, not only exactly these."""
        return self.certificate is not None and covers_smaller(self.certificate["claim"])

    @property
    def verdict(self) -> Literal["certified"] | delay_lti.Verdict:
        """What is decided: "certified", "unstable" (proved for the nominal loop), "undecided"."""
        if self.certified:
            return "certified"
        if (
            self.abscissa is None
            or self.abscissa < 0
            or any(delay.sampled for delay in self.system.delays)
        ):
            return "undecided"
        return delay_lti.verdict_of(self.system, self.K, self.abscissa)[0]

    @property
    def pair(self) -> ObserverPair:
        """Plant and observer as one system.

        Raises
        ------
        InputError : the state is fed back, and there is no observer.
        """
        if self.observer is None:
            raise InputError(
                "this design feeds back the state: it has no observer", where=self.system.name
            )
        return self.observer

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """What the observer receives, with the noise that is proved; empty without one."""
        return () if self.observer is None else self.observer.measurements

    @property
    def L(self) -> tuple[Matrix, ...]:
        """The injection (n, k_i) of every measurement."""
        return () if self.observer is None else self.observer.L

    @property
    def supports(self) -> str:
        """The support of each delay that the proof names: "delay 1: states 3, 4"."""
        if self.certificate is None or "terms" not in self.certificate.get("variables", {}):
            return ""
        delays = self.certificate["system"]["delays"]
        positive = [i for i, delay in enumerate(delays, 1) if delay["d"] > 0]
        each = zip(positive, self.certificate["variables"]["terms"], strict=True)
        return "; ".join(
            f"delay {i}: {of} {', '.join(map(str, term[of]))}"
            for i, term in each
            for of in ("states", "controls")
            if of in term
        )

    def to_json(self) -> dict[str, Any]:
        """Return JSON values: `claim`, `system`, `variables`, `K` of the proof, and `figures`.

        Raises
        ------
        InputError : nothing is proved.
        """
        self._require_certificate()
        return {**self.certificate, "figures": figures_to_json(self.least_gamma, self.figures)}

    def save(self, path: AnyPath) -> Path:
        """Write the design to a JSON file, as `cosim design --save`; return its path.

        Raises
        ------
        InputError : nothing is proved, or the file cannot be written.
        """
        text = self.file_text()
        with not_written("the design", Path(path)):
            write_whole(Path(path), text.encode())
        return Path(path)

    def file_text(self) -> str:
        """Return the JSON that its file has."""
        return json.dumps(DESIGN_FILE.stamped(self.to_json()), indent=1, allow_nan=False) + "\n"

    @classmethod
    def load(cls, path: AnyPath) -> Self:
        """Read a design from its file, and check its proof again.

        Raises
        ------
        InputError : no such file, not a design, or one whose proof does not hold.
        """
        return cls.from_json(read_certificate(Path(path)), where=str(path))

    @classmethod
    def from_json(cls, data: Any, *, where: str = "design") -> Self:
        """Read a design from its JSON, and check its proof again.

        Raises
        ------
        InputError : not a design, or one whose proof does not hold.
        """
        observes = _observes(data)
        _require_proof(data, where)
        figures = data.get("figures")
        if not observes and not has_figures(figures):
            if "kind" in data:
                got = "an analysis, without figures"
                raise InputError("not a design", where=where, got=got)
            raise InputError(
                "this design has not the figures of a design",
                where=where,
                expected=f"figures: {', '.join(FIGURES)}, optionally {', '.join(LATER_FIGURES)}",
                got=format_value(sorted(figures) if isinstance(figures, dict) else figures),
            )
        if observes and not (has_figures(figures) and "delay_margin" in figures):
            return cls.from_certificate(data, where=where)  # older files have not all of them
        facts = proved_facts(data)
        least, kept = figures_from_json(figures, where, *_loop_of(facts))
        return cls(**facts, figures=kept, certificate=_kept(data), least_gamma=least)

    @classmethod
    def from_certificate(cls, data: Any, *, where: str) -> Self:
        """Read a design from its certificate alone, as a controller FMU carries it.

        The figures of the nominal loop, which no claim depends on, are computed.

        Raises
        ------
        InputError : a proof that does not hold, or that is not about a gain.
        """
        _require_proof(data, where)
        K, variables = data.get("K"), data.get("variables")
        if not _observes(data) and (
            not K or not K[0] or not isinstance(variables, dict) or "gamma" not in variables
        ):
            got = f"a certificate of kind {data['kind']}" if "kind" in data else "no gain K"
            raise InputError("not a design", where=where, expected="the proof of a gain", got=got)
        facts = proved_facts(data)
        figures, _ = delay_lti.figures_if_known(*_loop_of(facts))
        return cls(**facts, figures=figures, certificate=_kept(data))

    def check(self) -> CertificateCheck:
        """Check the proof in rational arithmetic, without a solver; once for the same result.

        Raises
        ------
        InputError : nothing is proved.
        """
        self._require_certificate()
        return self._checked

    def _require_certificate(self) -> None:
        if self.certificate is None:
            raise InputError(
                "nothing is proved, and so there is nothing to save", got=self.reason or ""
            )

    @cached_property
    def loop(self) -> delay_lti.DelayLTI:
        """The nominal closed loop from w to z, for responses, margins and plots."""
        pair = self.observer
        system, K = (self.system, self.K) if pair is None else (pair.system, pair.gain)
        return delay_lti.lti(system, gain=K)

    def __repr__(self) -> str:
        name = f" {self.system.name!r}" if self.system.name else ""
        what = f"K = {matrix_text(self.K)}" if self.K.any() else "u = 0"
        if self.observer is not None:
            what = f"observer of {', '.join(x.name for x in self.measurements)}"
        return f"<Result{name}: {what}, {self._proved_words()}>"

    def _repr_html_(self) -> str:
        """Return the gains, what is proved and the figures of the loop, for notebooks."""
        rows = {"system": repr(self.system)[1:-1]}
        rows |= {"K": matrix_text(self.K, most=24)} if self.K.any() else {}
        for x, L_i in zip(self.measurements, self.L, strict=True):
            rows[f"L of {x.name}"] = matrix_text(L_i)
        rows["certified"] = self._proved_words()
        if self.supports:
            rows["proved on the support of each delay"] = self.supports
        if self.abscissa is not None:
            rows["rightmost root (computed)"] = f"real part {self.abscissa:.6g} 1/s"
        if self.exact_norm is not None:
            rows["norm of the nominal loop (computed)"] = f"{self.exact_norm:.6g}"
        if self.exact_norm_upper is not None:
            rows["the same, an upper bound (proved)"] = f"{self.exact_norm_upper:.6g}"
        for i, margin in enumerate(self.delay_margin or (), 1):
            rows[f"stable up to delay {i} of (computed)"] = (
                "any" if margin is None else f"{margin:.6g} s"
            )
        return html_table(repr(self), rows)

    def _proved_words(self) -> str:
        """Return what is proved, in a few words."""
        if not self.certified:
            return f"not certified: {self.reason or 'the proof does not hold'}"
        cover = self.system.delays and self.covers_smaller_delays
        what = "stability" if self.gamma is None else f"gamma {self.gamma:.6g}"
        return (
            f"{what} certified"
            + (", for every smaller delay too" if cover else "")
            + (", on the support of each delay" if self.supports else "")
        )


def proved_facts(certificate: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a certificate of a gain or of an observer proves, as attributes of a `Result`.

    Raises
    ------
    InputError : naming the key, what was expected and what was got.
    """
    data = dict(certificate)
    observer = pair_from_json(data) if data.get("kind") == "output-feedback" else None
    proof = data if observer is None else dict(data["pair"])
    system = system_from_json(proof["system"])
    gain, variables = gain_from_json(proof["K"], system), proof["variables"]
    gamma = variables["gamma"]
    return {
        "system": system if observer is None else observer.plant,
        "K": gain if observer is None else observer.K,
        "gamma": None if gamma is None else float(Fraction(gamma)),
        "order": variables.get("order"),
        "k1": _numbers(variables, "k1"),
        "k2": _numbers(variables, "k2"),
        "guarantees": guarantees_from_json(proof, system, gain),
        "observer": observer,
    }


def _numbers(variables: Mapping[str, Any], key: str) -> tuple[float, ...]:
    return tuple(float(Fraction(x)) for x in variables[key]) if key in variables else ()


def _observes(data: Any) -> bool:
    return isinstance(data, dict) and data.get("kind") == "output-feedback"


def _require_proof(data: Any, where: str) -> None:
    proof = check_certificate(data)
    if not proof.valid:
        raise InputError("the proof of this design does not hold", where=where, got=proof.reason)


def _loop_of(facts: dict[str, Any]) -> tuple[DelaySystem, Matrix]:
    """Return the system and the gain of the loop that a proof is about."""
    pair = facts["observer"]
    return (facts["system"], facts["K"]) if pair is None else (pair.system, pair.gain)


def _kept(data: dict[str, Any]) -> dict[str, Any]:
    """Return the certificate in a file."""
    if _observes(data):
        return {key: value for key, value in data.items() if key not in ("figures", "schema")}
    return {key: data[key] for key in _OF_A_GAIN if key in data}
