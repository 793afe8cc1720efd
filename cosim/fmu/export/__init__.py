"""Export FMUs: components, their variables and equations, packed for FMI 2.0 and 3.0."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
