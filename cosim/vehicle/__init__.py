"""Your vehicle as a file: its equations, its plant FMU, and what a design for it needs."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
