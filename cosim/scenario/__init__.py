"""Scripted scenarios: read, assemble, fly, judge; from Python: `run`, `open_session`."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
