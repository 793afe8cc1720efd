"""Systems with internal delays by themselves: in and out, responses, margins, plots."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
