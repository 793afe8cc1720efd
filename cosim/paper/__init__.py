"""The paper, claim by claim: the printed result, the computed one, and why they differ."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
