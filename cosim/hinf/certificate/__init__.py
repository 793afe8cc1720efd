"""The prover: certificates, what they prove, and the exact arithmetic that checks it; no solver."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
