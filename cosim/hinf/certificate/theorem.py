"""The theorem behind a claim, in words: every hypothesis and every conclusion, one per sentence.

A certificate has them under "theorem". They follow from its claim alone, and are checked against
it; older certificates are without them.
"""

from __future__ import annotations

from typing import Any

_SYSTEM = (
    "system: x' = sum_i (A_i + dA_i) x(t - tau_i) + B u + C w for almost every t >= 0, tau_0 = 0; "
    "z = D x + D1 w + D2 u"
)
_GAIN = (
    "conclusion: x = 0 for t <= 0 (zero initial function), w in L2[0, T], measurable: then the "
    "integral of z'z over [0, T] is at most gamma^2 times that of w'w, for every T > 0, also "
    "T = infinity"
)
_SAMPLED = (
    "a sampled age, a = least_age: x(t - tau) = x(s_k) for s_k + a <= t < s_(k+1) + a, "
    "0 < s_(k+1) - s_k <= d - a, s_0 + a <= 0, finitely many s_k in any bounded time"
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
        texts.append("an age with a bounded rate is Lipschitz continuous")
    if any(age.startswith("sampled") for age in ages):
        texts.append(_SAMPLED)
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
