"""The vehicle files that `cosim vehicle new` writes: one of the gallery, every key explained."""

from __future__ import annotations

import re
import textwrap

from cosim.core import InputError
from cosim.vehicle.keys import vehicle_tables
from cosim.vehicle.read import vehicle_text

_HEAD = """\
# {name}: a vehicle, begun as a copy of {like}. SI units; body axes x forward, y to starboard,
# z down; the earth's north, east, down. Forces and moments as they act: damping is negative.
#   cosim vehicle check {file}     list its faults
#   cosim vehicle show {file}      trim, poles, drag, actuators, sensors
#   cosim vehicle fly {file}       design for it, and fly it over a slow link
# Every key: cosim vehicle show --keys
"""
_KEY = re.compile(r'(?P<key>"[^"]+"|[A-Za-z_][\w.]*)\s*=')
_TABLE = re.compile(r"\[\[?[a-z_]+\]\]?")
_WIDTH = 96
_TOP = "top of the file"


def vehicle_template(name: str, like: str) -> str:
    """Return a vehicle file like one of the gallery, with a comment for every key.

    Raises
    ------
    InputError : a name that no vehicle can have, or no such vehicle in the gallery.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
        raise InputError(
            "not a valid name for a vehicle",
            where=name,
            expected="a letter, then letters, digits, _ or -",
        )
    tables = vehicle_tables()
    lines = [_HEAD.format(name=name, like=like, file=f"{name}.toml")]
    heading, explained, inside = _TOP, set[tuple[str, str]](), False
    for line in vehicle_text(like).splitlines():
        match = None if inside else _KEY.match(line)
        if _TABLE.fullmatch(line):
            heading = line
            purpose = "" if line not in tables else tables[line][0]
            lines += _comment(purpose) if (heading, "") not in explained else []
            explained.add((heading, ""))
        elif match is not None:
            key = match["key"].strip('"')
            known = tables[heading][1].get(key) if heading in tables else None
            if known is not None and (heading, key) not in explained:
                lines += _comment(known.text)
            explained.add((heading, key))
            if heading == _TOP and key == "name":
                line = f'name = "{name}"'  # noqa: PLW2901 - the copy has a name of its own
        lines.append(line)
        inside ^= line.count('"""') % 2 == 1
    return "\n".join(lines) + "\n"


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, _WIDTH)]
