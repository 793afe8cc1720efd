"""Studies: thousands of runs of one scenario, each with other values; on one core or on many.

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

from cosim.study.boundary import Boundary, boundary, loop_delay_margin
from cosim.study.conduct import Finished
from cosim.study.read import LoadedStudy, builtin_studies, load_study
from cosim.study.running import run_study
from cosim.study.schema import GridAxis, Metric, ReplicatesAxis, SampledAxis, Study
from cosim.study.summary import Summary, summarise
from cosim.study.table import read_table

__all__ = [
    "Boundary",
    "Finished",
    "GridAxis",
    "LoadedStudy",
    "Metric",
    "ReplicatesAxis",
    "SampledAxis",
    "Study",
    "Summary",
    "boundary",
    "builtin_studies",
    "load_study",
    "loop_delay_margin",
    "read_table",
    "run_study",
    "summarise",
]
