"""The links of a run: which messages arrive when, and what their receivers use."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
