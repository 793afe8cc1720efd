"""Settings shared by all tests.

Standing here, in a folder that is no package, this file also puts `tests/` on the import
path, so that a test can say `from truth.dde import solve`: `tests/truth` holds the yardsticks
that share no code with what they measure.
"""

from __future__ import annotations

import os

from hypothesis import settings

# Drawn without a display, and before anything imports matplotlib.
os.environ["MPLBACKEND"] = "Agg"

# The same examples on every run and machine; a slow machine is no failure.
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")
