"""H-infinity design over delays: the LMI, its exact proof, figures of the nominal loop.

This face has what a user needs who proves a loop. All else is in seven rooms, each with a face of
its own (`cosim.hinf.delay_lti`); imports point one way, `models` and `core` below all:

    synthesis -> lmi -> problem -> certificate -> theorems -> exact
    synthesis -> delay_lti -> certificate

`delay_lti` has what is computed of a loop without uncertainty, and of any system with internal
delays: roots, norm, margins, responses in time, models of other libraries in and out.

`exact` are numbers without rounding, `theorems` what is proved with them, each theorem once, as
terms over named rows. `certificate` is the prover. These three load no solver and no other room,
so that a proof can be checked by less code than found it; the JSON of systems is there because a
certificate contains one.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
