"""What a run came to: its cause, assertions, events, and the verdict of all views."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
