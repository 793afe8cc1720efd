"""The scenario files that `cosim scenario new` writes."""

from __future__ import annotations

from cosim.scenario.read import load

_WHOLE = '''\
# A scenario: components, connections, links, events and assertions.
# Times are in seconds and everything else in SI; "50 ms", "20 deg", "2 kN" are numbers too.
#   cosim scenario check {name}.toml     list its errors
#   cosim run {name}.toml                run it
schema = 1
title = "{name}"
description = """
Why these numbers are plausible.
"""

[run]
end = "60 s"
step = "50 ms"
seed = 1
# algorithm = "gauss-seidel"   # components one after the other; else "jacobi"
# events = "grid"              # messages on the grid of steps; else "align"

[components.plant]
fmu = "AuvPlant"               # of the catalogue, or the path of any .fmu
# step = "0.1 s"               # a communication step of its own
[components.plant.parameters]
"initial.eta.x" = "0.5 m"

[components.controller]
fmu = "HinfController"
[components.controller.parameters]
"eta.x" = "0.5 m"              # used until the first message arrives

[components.sea]
fmu = "WaveField"
parameters = {{ Hs = 0.5, Tp = 8.0 }}

# from -> to, groups of variables or single ones, over a link if one is named.
# Short form: connect = ["plant.eta -> controller.eta : uplink", ...]
[[connections]]
from = "sea.disturbance"
to = "plant.disturbance"

[[connections]]
from = "plant.eta"
to = "controller.eta"
link = "uplink"

[[connections]]
from = "plant.nu"
to = "controller.nu"
link = "uplink"

[[connections]]
from = "controller.force"
to = "plant.force"

[[connections]]
from = "controller.moment"
to = "plant.moment"

[links.uplink]
kind = "packet"                # messages; "transport": a continuous signal, delayed
sample_time = "0.2 s"
delay = "0.3 s"                # or {{ range = [...], from = [...] }}, or recorded
loss = "5 %"                   # or {{ p_enter = 0.05, p_exit = 0.3 }}: in bursts
# jitter = {{ kind = "uniform", width = "50 ms" }}

# What happens during the run: at a time, or when a condition becomes true.
[[events]]
at = "30 s"
for = "3 s"
outage = ["uplink"]

# [[events]]
# when = "plant.eta.z > 5 m and t > 10 s"
# override = {{ "plant.force.z" = "-100 N" }}
# for = "2 s"

# What must hold; the run ends with exit code 1 if it does not.
[[assertions]]
name = "stays near its station"
always = "hypot(plant.eta.x, plant.eta.y) < 2 m"

# [[assertions]]
# within = {{ of = "20 s", when = "uplink.age > 1 s", holds = "uplink.age < 1 s" }}
# after = "5 s"

# The gain: without [design] the controller uses its own.
# [design]
# system = "auv"
# loop_delay = "1.25 s"        # a design is made once, and kept in {name}.design.json
# file = "auv-1.25s"           # or an existing design: of the package, FILE.json, FILE.fmu
'''

_EXTENSION = """\
# {base} with the changes below.
#   cosim scenario show {name}.toml      the merged scenario
#   cosim scenario check {name}.toml     list its errors
#   cosim run {name}.toml                run it
# Tables are merged; lists, the connections among them, are replaced.
schema = 1
extends = "{base}"
title = "{title}, changed"
# without = ["reference"]              # removes parts of {base}

[run]
end = "{end:g} s"
# seed = 2
{links}
# [[events]]
# at = "10 s"
# for = "5 s"
# bias = {{ "plant.eta.x" = {{ offset = "0.5 m" }} }}

# [[assertions]]
# always = "t >= 0 s"
"""


def template(name: str, base: str | None = None) -> str:
    """Return the text of a new scenario: complete, or extending `base`.

        >>> from pathlib import Path
        >>> from cosim import Scenario
        >>> from cosim.scenario import template
        >>> written = Path("mine.toml").write_text(template("mine", base="paper-example"))
        >>> Scenario.load("mine.toml")
        <Scenario mine: plant, controller, exosystem; no links>

    Raises
    ------
    InputError : `base` is no scenario.
    """
    if base is None:
        return _WHOLE.format(name=name)
    scenario = load(base).scenario
    links = "".join(f'\n# [links.{link}]\n# delay = "0.4 s"\n' for link in scenario.links)
    title = scenario.title.replace("\\", "\\\\").replace('"', '\\"')
    return _EXTENSION.format(name=name, base=base, title=title, end=scenario.run.end, links=links)
