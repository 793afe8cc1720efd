"""Report a trace as one HTML file: verdict, path, signals, links; or two side by side."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
