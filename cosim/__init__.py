"""Certified delay-dependent control, packed as FMUs, co-simulated over links with delay and loss.

The names below are the front door; each loads what it needs when it is first used. Every package
has a face of its own: `cosim.hinf`, `cosim.fmu`, `cosim.network`, `cosim.master`, `cosim.trace`,
`cosim.scenario`, `cosim.replay`, `cosim.study`.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
