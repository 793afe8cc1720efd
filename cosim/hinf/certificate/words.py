"""The words of all claims: of theorems, guarantees and ages; and of a claim, sentence by sentence.

A certificate has the sentences under "theorem": every hypothesis and every conclusion. They follow
from its claim alone, and are checked against it; older certificates are without them.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any


class AgeWord(StrEnum):
    """What a claim says of an age tau of a delay; d, least_age and rate stand beside it."""

    ANY = "any, however it varies, up to d"
    ANY_FROM = "any, however it varies, from least_age to d"
    RATE = "from least_age to d, |age'| <= rate"
    SAMPLED = "sampled: from least_age at rate one to d at most"
    UP_TO = "constant, up to d"
    EXACTLY = "constant, exactly d"


AGE_FROM = "constant, from {least} to d"
"""Of a constant delay that is covered down to a least one, p/q."""

PROPERTIES = {
    "stability": "stability",
    "gain": "stability and H-infinity gain <= gamma",
    "norm": "stability and H-infinity norm < gamma of the nominal loop",
    "refutation": "no X, Y, Q, R, eps meets the LMI of Theorem 2 at these k1, k2",
    "gamma floor": "no delay, k1, k2 and K meet the LMI of Theorem 2: gamma <= ||D1||",
    "decay": "every solution with w = 0 decays at least as exp(-rate t)",
    "damping": "nominal loop (F = 0, every age constant, exactly d): every characteristic root s "
    "with Re s >= -within has a damping ratio -Re s / |s| > ratio",
    "gain_limit": "the largest singular value of K is at most bound",
    "peak_control": "|u_i(t)| <= bounds_i for every t, from any constant initial state with |x_i| "
    "<= offset_i, with any w of int w'w <= energy^2",
    "state_peaks": "|g_i x(t)| <= bounds_i for every t >= 0, g_i the rows, from any constant "
    "initial state sum_k a_k s_k, |a_k| <= 1, s_k the columns of starts, with any w of int w'w <= "
    "energy^2",
    "outages": "in touch (every age of the feedback at most its d) V' <= -2 alpha V, out of touch "
    "(u = fallback x(t - o), 0 <= o <= fallback_age) V' <= 2 beta V, one V >= x'P x for both, and "
    "so V(T) <= V(0) exp(2 beta T_out - 2 alpha T_touch) with w = 0, whichever way the time is "
    "divided",
    "outages with a gain": "; from x = 0 the integral over [0, T] of s z'z is at most gamma^2 "
    "times that of s w'w, s = exp(2 alpha T_touch - 2 beta T_out) up to each instant",
}
"""What is proved, by theorem and guarantee."""

_HYPOTHESES = {
    "system": "x' = sum_i (A_i + dA_i) x(t - age_i(t)) + B u + C w for almost every t >= 0",
    "whole state": "u = K x(t - age_f(t)): the whole state is measured",
    "single states": "u = K sum_i S_i x(t - age_i(t)), S_i the diagonal of the truth values of "
    "feedback",
    "single entries": "u = sum_i (K o M_i) x(t - age_i(t)), M_i the truth values of feedback by "
    "entry of K",
    "age": "every age is a measurable function of time",
    "stability": "stability: w = 0 and any continuous initial function on [-max d, 0]",
    "gain": "gain: x = 0 for t <= 0, w square integrable on [0, T], and then the integral of z'z "
    "over [0, T] is at most gamma^2 times that of w'w, for every T > 0",
    "rate": "an age with a bounded rate is Lipschitz continuous",
    "sampled": "a sampled age, a = least_age: x(t - age) = x(s_k) for s_k + a <= t < s_(k+1) + a, "
    "0 < s_(k+1) - s_k <= d - a, s_0 + a <= 0, finitely many s_k in any bounded time",
}
"""What the claim of ages as they are asks for."""

_SYSTEM = (
    "system: x' = sum_i (A_i + dA_i) x(t - tau_i) + B u + C w for almost every t >= 0, tau_0 = 0; "
    "z = D x + D1 w + D2 u"
)
_GAIN = (
    "conclusion: x = 0 for t <= 0 (zero initial function), w in L2[0, T], measurable: then the "
    "integral of z'z over [0, T] is at most gamma^2 times that of w'w, for every T > 0, also "
    "T = infinity"
)


def theorem_of(claim: dict[str, Any]) -> list[str]:
    """Return the sentences of a claim, as JSON values."""
    texts = [*_observer(claim), _SYSTEM, *_feedback(claim)]
    for i, delay in enumerate(claim["delays"], 1):
        known = [f"{key} = {delay[key]!r}" for key in ("d", "least_age", "rate") if key in delay]
        texts.append(f"age {i}: tau_{i} is {delay['age']}, in seconds, {', '.join(known)}")
    ages = [delay["age"] for delay in claim["delays"]]
    if any(not age.startswith("constant") for age in ages):
        texts.append("an age that varies is a measurable function of time")
    if any("|age'|" in age for age in ages):
        texts.append(_HYPOTHESES["rate"])
    if any(age.startswith("sampled") for age in ages):
        texts.append(_HYPOTHESES["sampled"].replace("age)", "tau)"))
    texts.append(
        f"uncertainty: [dA_0 ... dA_N] = E F(t) [H_0 ... H_N], {uncertainty_text(claim, 'F')}"
        if claim["uncertain"]
        else "uncertainty: none, every dA_i = 0"
    )
    texts.append(
        "numbers: those of system and K are the doubles of this file, taken exactly; a p/q is the "
        "rational that it is; nothing is rounded"
    )
    if not claim["property"].startswith("stability"):
        return [*texts, f"conclusion: {claim['property']}"]
    texts.append("conclusion: w = 0 and any continuous initial function on [-max d, 0]: x(t) -> 0")
    if claim["gamma"] is not None:
        texts.append(_GAIN)
    more = claim.get("guarantees", {}).values()
    return texts + [f"conclusion: {one['property']}" for one in more]


def hypotheses(claim: dict[str, Any], *, measured: str) -> list[str]:
    """Return what a theorem of ages as they are asks for, sentence by sentence.

    measured : "whole state", "single states" or "single entries".
    """
    ages = [delay["age"] for delay in claim["delays"]]
    asked = ["system", measured, "age", "stability", *(["gain"] if claim["gamma"] else [])]
    texts = [_HYPOTHESES[name] for name in asked]
    if claim["uncertain"]:
        texts.append(f"uncertainty: {uncertainty_text(claim)}")
    of_ages = {"rate": AgeWord.RATE, "sampled": AgeWord.SAMPLED}
    return texts + [_HYPOTHESES[name] for name, word in of_ages.items() if word in ages]


def uncertainty_text(claim: dict[str, Any], F: str = "F(t)") -> str:
    """Return which F is covered by a claim with uncertainty; `F` is its name."""
    text = f"{F} measurable, F(t)'F(t) <= I, the same F in every term"
    if "uncertainty_blocks" not in claim:
        return text
    sizes = claim["uncertainty_blocks"]
    names = [f"F_{i}" for i in range(1, len(sizes) + 1)]
    each = ", ".join(f"{name} {p} x {q}" for name, (p, q) in zip(names, sizes, strict=True))
    text = text.replace("F(t)'F(t)", "F_i(t)'F_i(t)")
    return f"F = diag({', '.join(names)}), {each}, {text}; real or complex"


def _observer(claim: dict[str, Any]) -> list[str]:
    """Return what the pair is made of; nothing where a claim is not about an output feedback."""
    if "observer" not in claim:
        return []
    observer = claim["observer"]
    age, names = observer["command_age"], ", ".join(observer["measurements"])
    kind = "any age from 0 to" if observer["command_any_age"] else "exactly"
    acting = f"tau_c is {kind} {age!r} s" if age else "tau_c = 0"
    known = ", ".join(str(j) for j in observer["known_states"])
    plant = (
        "plant: xp' = sum_j (A_j + dA_j) xp(t - d_j) + B u + C w, the matrices of plant; "
        f"measurements y_i = C_i xp + N_i w_i, N_i the diagonal of noise: {names}"
    )
    estimate = (
        "observer: xh' = sum_j A_j xh(t - d_j) + B u + sum_i L_i (y_i - C_i xh)(t - tau_i), with u "
        "as it acts, d_j the plant's constant delay or the greatest age of one that varies, and "
        "xh stored at the stamp of y_i"
    )
    command = f"command: u(t) = K xh(t - tau_c), {acting}"
    pair = "pair: x = (xp, xp - xh), w = (w, w_1 .. w_p); system and K are those of pair"
    if known:
        pair += f"; the estimates of states {known} equal them from the start, without an error"
    return [plant, estimate, command, pair]


def _feedback(claim: dict[str, Any]) -> list[str]:
    """Return what the control is; nothing where a claim is about every gain."""
    fed = [claim.get("feedback", False), *(delay["feedback"] for delay in claim["delays"])]
    if any(isinstance(one, list) and isinstance(one[0], list) for one in fed):
        text = (
            "control: u = sum_i (K o M_i) x(t - tau_i), M_i the rows of feedback, zeros and ones "
            "on the entries of K; one row for all where there is one"
        )
        return [text]
    if any(isinstance(one, list) for one in fed):
        return ["control: u = K sum_i S_i x(t - tau_i), S_i the diagonal of feedback"]
    acting = next((i for i, one in enumerate(fed) if one), 0)
    at = f"x(t - tau_{acting})" if acting else "x(t)"
    return [f"control: u = K {at}, u = 0 without inputs; the full state is measured, without error"]
