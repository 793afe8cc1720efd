"""Scenarios: read and check them, assemble their systems, run them, evaluate the runs."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
