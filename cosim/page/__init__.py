"""HTML pages that contain all they show and load nothing: look, charts, policy, file."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
