"""Systems with delays, without the LMI: roots, the norm and its proof, margins, responses in time.

One form stands behind all: blocks A, B, C, D around internal delays (`Blocks`). A loop of Eq. (7)
is closed to them, a `DelayLTI` is made of them; roots, norm and margins are computed of them alone.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
