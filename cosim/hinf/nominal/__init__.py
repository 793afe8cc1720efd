"""The nominal loop, without the LMI: its roots, its norm and the proof, its delay margins."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
