"""Inspect any FMU without loading it: what it is, what it needs, what is wrong with it."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
