"""What is to be controlled: systems by name or file, the vehicle's, weights, design constraints."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
