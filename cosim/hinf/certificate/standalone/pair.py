"""The pair of plant and observer, for `checker.py`: hold the loop that is proved against it.

With e = x - xh, L_i = injection, N_i = diagonal of the noise, and everything exact:

    x' = sum_j A_j x(t-d_j) + B K (x - e)(t-tau_c) + C w,   z = D x + D1 w + D2 K (x - e)(t-tau_c)
    e' = sum_j A_j e(t-d_j) + C w - sum_i (L_i C_i e(t-tau_i) + L_i N_i w_i)

and E F (sum_j H_j x(t-d_j)) in both. For a delay of the plant that varies e' has instead
A_j (x(t-tau_j) - (x - e)(t-d_j)), d_j its greatest. The closed loop of the file is held against
these, term by term; a state that is known has no e.
"""

# mypy: ignore-errors
# ruff: noqa: ANN001, ANN201, ANN202, B905, D103, SIM300

from . import arithmetic as sn

M, need, total = sn.M, sn.need, sn.total

AGE = "d any_age least_age rate sampled"


def observer_claim(c):
    return {
        "measurements": [x["name"] for x in c["measurements"]],
        "noise": [x["noise"] for x in c["measurements"]],
        "known_states": [j for j, is_estimated in enumerate(c["estimated"], 1) if not is_estimated],
        "command_age": c["command_age"],
        "command_any_age": c["command_any_age"],
    }


def need_pair(c, plant, s):
    """Refuse unless the loop s is the pair of the certificate's plant, measurements, K and L."""
    n, m, sensors, chosen = plant.n, plant.m, c["measurements"], c["estimated"]
    need(len(chosen) == n and all(type(x) is bool for x in chosen), "estimated is no truth value")
    need(len(sensors) == len(c["L"]) > 0, "not one injection per measurement")
    need(plant.whole and plant.fed[0] is True, "not a plant of a pair")
    need(type(c["command_any_age"]) is bool, "neither true nor false")
    e = [j for j in range(n) if chosen[j]]
    up = M({(n + i, j): sn.Fraction(1) for i, j in enumerate(e)})  # puts estimated rows below
    both, K = sn.eye(n) + up, sn.matrix(c["K"], m, n, sn.number)
    estimate = sn.eye(n) + -1 * up.T  # (n, N): the estimate of (x, e)

    def of_both(A):
        known = M({(i, j): x for (i, j), x in A.items() if not chosen[i] and chosen[j]})
        need(not known, "a state is not known")
        return A + up @ A @ up.T

    for A in (plant.C, plant.E):
        need(all(chosen[i] for i, _ in A), "a state is not known")
    A, H, ages = [of_both(plant.open[0])], plant.H[:1], []
    for table, A_j, H_j, varies in zip(plant.delays, plant.open[1:], plant.H[1:], plant.varies[1:]):
        apart = varies and A_j
        need(not apart or all(chosen[i] for i, _ in A_j), "a state is not known")
        terms = [(both @ A_j, H_j, table)] if apart else [(of_both(A_j), H_j, table)]
        if apart:
            terms.append((-1 * up @ A_j @ estimate, M(), {"d": table["d"]}))
        for one, other, L_i in terms:
            A, H, ages = [*A, one], [*H, other], [*ages, age_of(L_i)]
    D = [plant.open_D, *(M() for _ in ages)]
    command_age = sn.number(c["command_age"])
    need(command_age >= 0, "a negative age of the command")
    A_u, D_u = plant.B @ K @ estimate, plant.D2 @ K @ estimate
    if command_age > 0:
        A, D, H = [*A, A_u], [*D, D_u], [*H, M()]
        ages.append(age_of({"d": command_age, "any_age": c["command_any_age"]}))
    else:
        A[0], D[0] = A[0] + A_u, D[0] + D_u
    columns, C = plant.q, both @ plant.C
    for table, rows in zip(sensors, c["L"]):
        sn.values(table, "name C d any_age noise over", "least_age rate sampled")
        k = len(table["C"])
        L, C_i = sn.matrix(rows, n, k, sn.number), sn.matrix(table["C"], k, n, sn.number)
        need(all(chosen[i] for i, _ in L), "a state that is known is corrected")
        A, D, H = [*A, -1 * up @ L @ C_i @ up.T], [*D, M()], [*H, M()]
        ages.append(age_of(table))
        noise = [sn.number(x) for x in table["noise"]]
        need(len(noise) == k and min(noise) >= 0, "not one noise per value")
        for i, size in enumerate(noise):
            if size > 0:
                C = C + -1 * up @ L @ M({(i, columns): size})
                columns += 1
    sizes = (s.n, s.q, s.p, s.s, s.r, s.blocks)
    wanted = (n + len(e), columns, plant.p, plant.s, plant.r, plant.blocks)
    need(sizes == wanted and [age_of(x) for x in s.delays] == ages, "sizes or ages of the pair")
    same = s.A == A and s.D == D and s.H == H and s.C == C and s.D1 == plant.D1
    need(same and s.E == both @ plant.E, "the pair is not that of plant, measurements, K and L")


def age_of(table):
    known = {key: table[key] for key in AGE.split() if table.get(key)}
    varies = any(known.get(key) for key in ("any_age", "sampled")) or "rate" in table
    return known | {"any_age": varies, "d": sn.number(table["d"]), "rate": table.get("rate")}
