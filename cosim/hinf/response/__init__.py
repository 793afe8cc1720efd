"""Systems with internal delays to compute with: models in and out, connections, time responses."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
