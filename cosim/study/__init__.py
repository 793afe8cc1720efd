"""Studies: many runs of one scenario with different values, on one core or many.

from cosim.study import Study, run_study, read_table, summarise

study = Study(
title="How much delay the link may have",
scenario="auv-acoustic",
vary=[{"kind": "grid", "path": "links.uplink.delay", "linspace": [0.1, 1.0, 10]}],
metrics={"error": "metrics.position_error_m"},
)
done = run_study(study, Path("studies/delay"), workers="all")
table, about = read_table(done.results)
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
