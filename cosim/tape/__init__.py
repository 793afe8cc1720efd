"""Recorded arithmetic: carried out in Python, or written as C, operation by operation."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
