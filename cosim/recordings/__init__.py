"""Recordings of links: read from files and traces, described, and fitted with the models of links.

How a link replays one is in `cosim.network`.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
