"""Own C as libraries: those that the wheel brings, or compiled on this machine."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
