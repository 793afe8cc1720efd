"""Vehicle files for tests: one with every term, one without drag, and the vehicle of Table 1."""

from __future__ import annotations

from cosim.models import TABLE_1
from cosim.vehicle import Vehicle, vehicle_from_toml

EVERY_TERM = """\
schema = 1
name = "every-term"
description = "every term that a vehicle file has"
source = "made for tests"
degrees_of_freedom = 6

[body]
mass = 30.0
inertia = [[0.3, 0.01, -0.02], [0.01, 3.5, 0.015], [-0.02, 0.015, 3.4]]
r_g = [0.01, -0.005, 0.02]
r_b = [0.0, 0.002, -0.01]
weight = 294.0
buoyancy = 297.0
density = 1025.0
length = 1.6

[hydro]
coriolis_without = [[5, 1], [1, 5]]
X_udot = -1.0
Y_vdot = -28.0
Y_rdot = 1.5
N_vdot = 1.5
Z_wdot = -27.0
Z_qdot = -1.4
M_wdot = -1.4
K_pdot = -0.05
M_qdot = -3.0
N_rdot = -3.1
X_u = -2.0
Y_v = -3.0
"X_|u|u" = -5.0
"Y_v|v|" = -60.0
"N_|v|r" = -4.0
K_p = -0.4
M_q = -3.0
N_r = -2.0
Y_ur = 5.0
Z_uq = -5.0
N_uv = -8.0
fading = { Y_v = 3.0 }

[cross_flow]
height = 0.2
breadth = 0.25
drag = "hoerner"
strips = 6
coupled = true
softening = 1e-6

[lift_drag]
span = 0.2
area = 0.21
drag = 0.1
stall = 0.3

[onboard_damping]
rates = { q = 0.2, r = 0.3 }
delay = 0.3

[[thrusters]]
name = "propeller"
direction = [1.0, 0.0, 0.0]
position = [-0.8, 0.0, 0.01]
moment = [0.02, 0.0, 0.0]
limit = 15.0
lag = 0.5

[[thrusters]]
name = "bow"
direction = [0.0, 0.6, 0.8]
position = [0.5, 0.0, 0.0]
limit = 10.0

[[fins]]
name = "rudder"
area = 0.013
lift = 3.0
drag = 0.5
direction = [0.0, -1.0, 0.0]
position = [-0.7, 0.0, -0.02]
limit = 0.3
lag = 0.1

[[fins]]
name = "stern"
derivatives = { Z_uud = -6.0, M_uud = -4.0, X_uudd = -3.0 }
limit = 0.3

[[sensors]]
name = "dvl"
measures = ["nu.u", "nu.v", "nu.w"]
interval = 0.2
noise = 0.01

[[sensors]]
name = "position"
measures = ["eta.x", "eta.y"]
interval = 2.0
noise = [0.3, 0.3]
age = 3.0
over = "link"

[trim]
u = 1.0

[envelope]
"nu.u" = 0.3
nu.q = 0.1
"eta.theta" = 0.2

[control]
states = ["eta.z", "eta.theta", "nu.w", "nu.q"]
weights = { "eta.z" = 0.1, "fin.stern" = 1.0 }
"""

FREE = """\
name = "free"
degrees_of_freedom = 6
attitude = "ATTITUDE"

[body]
mass = 20.0
inertia = [[0.6, 0.02, -0.05], [0.02, 2.2, 0.03], [-0.05, 0.03, 2.4]]
r_g = [0.03, 0.01, 0.04]
r_b = [0.03, 0.01, 0.04]

[hydro]
X_udot = -4.0
Y_vdot = -15.0
Z_wdot = -18.0
K_pdot = -0.2
M_qdot = -1.1
N_rdot = -1.3
Y_rdot = 0.7
N_vdot = 0.7
Z_qdot = -0.9
M_wdot = -0.9
"""
"""A neutral vehicle without drag or torque: ATTITUDE is to be replaced."""


LEVEL = """\
name = "level"
degrees_of_freedom = {}

[body]
mass = 30.0
inertia = [0.3, 3.5, 3.4]
buoyancy = 290.0
density = 1025.0
length = 1.6

[hydro]
X_udot = -1.0
Y_vdot = -28.0
Y_rdot = 1.5
N_vdot = 1.5
Z_wdot = -27.0
N_rdot = -3.1
X_u = -2.0
"Y_v|v|" = -60.0
"N_|v|r" = -4.0
N_r = -2.0
Y_ur = 5.0
Z_uw = -5.0
fading = {{ X_u = 3.0 }}

[cross_flow]
height = 0.2
breadth = 0.25
drag = [0.9, 1.1]
strips = 6

[lift_drag]
span = 0.2
area = 0.21
drag = 0.1

[onboard_damping]
rates = {{ u = 0.2, r = 0.3 }}
delay = 0.3

[[thrusters]]
name = "stern"
direction = [0.0, 1.0, 0.0]
position = [-0.8, 0.0, 0.01]
limit = 15.0
lag = 0.5

[[fins]]
name = "rudder"
area = 0.013
lift = 3.0
drag = 0.5
direction = [0.0, -1.0, 0.0]
position = [-0.7, 0.0, -0.02]
limit = 0.3
"""


def level(degrees_of_freedom: int) -> Vehicle:
    """A vehicle whose roll and pitch, if it has them, do not move the others at once."""
    return vehicle_from_toml(LEVEL.format(degrees_of_freedom), where="level.toml")


def free(more: str = "", *, attitude: str = "euler", **changes: str) -> Vehicle:
    """The vehicle FREE with more lines of [hydro], and keys of [body] in place of its."""
    lines = FREE.replace("ATTITUDE", attitude).splitlines()
    for key, value in changes.items():
        lines = [line for line in lines if not line.startswith(f"{key} =")]
        lines.insert(lines.index("[body]") + 1, f"{key} = {value}")
    return vehicle_from_toml("\n".join(lines) + f"\n{more}", where="free.toml")


def table_1() -> Vehicle:
    """The vehicle of Table 1 in 4 degrees of freedom, with its forces as thrusters."""
    lines = [
        'name = "table-1"\ndegrees_of_freedom = 4\n[body]',
        f"mass = {TABLE_1['mass']}\ninertia = [0.0, 0.0, {TABLE_1['inertia.z']}]",
        f"density = {TABLE_1['density']}\nlength = {TABLE_1['length']}",
        '[hydro]\nprime = true\ncoriolis = "given"',
        *(f"{n[6:]} = {x!r}" for n, x in TABLE_1.items() if n.startswith("hydro.")),
        "[onboard_damping]\nrates = { u = 0.05, v = 0.05, w = 0.05, r = 0.05 }\ndelay = 0.5",
    ]
    force = "[[thrusters]]\nname = '{}'\ndirection = {}\nmoment = {}\nlimit = 1e4"
    for i, name in enumerate("xyz"):
        lines.append(force.format(name, [float(i == j) for j in range(3)], [0.0] * 3))
    lines.append(force.format("yaw", [0.0] * 3, [0.0, 0.0, 1.0]))
    return vehicle_from_toml("\n".join(lines), where="table-1.toml")


def every_term(attitude: str = "euler") -> Vehicle:
    """The vehicle with every term."""
    text = EVERY_TERM.replace("[body]", f'attitude = "{attitude}"\n[body]', 1)
    return vehicle_from_toml(text, where="every.toml")
