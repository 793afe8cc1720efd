"""What is proved, each theorem in one file: inequalities as lists of terms; no solver."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
