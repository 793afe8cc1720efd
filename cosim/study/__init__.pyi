from .answer import (
    answers_of as answers_of,
    pooling_words as pooling_words,
)
from .columns import columns_of as columns_of
from .execution import (
    StudyResult as StudyResult,
    execute_study as execute_study,
)
from .folder import read_rows as read_rows
from .grid_runs import sweep as sweep
from .importance import importance_sampling as importance_sampling
from .merge import (
    MergedStudy as MergedStudy,
    merge_studies as merge_studies,
)
from .picture_kinds import (
    PICTURE_KINDS as PICTURE_KINDS,
    draw_study as draw_study,
)
from .pictures import draw as draw
from .plan import (
    Plan as Plan,
    check_runs as check_runs,
)
from .points import Points as Points
from .rare_events import (
    RareEstimate as RareEstimate,
    estimated as estimated,
)
from .read import (
    LoadedStudy as LoadedStudy,
    builtin_studies as builtin_studies,
    load_study as load_study,
)
from .repeat import (
    check_unchanged as check_unchanged,
    repeat_run as repeat_run,
)
from .report import (
    StudyReport as StudyReport,
    write_study_report as write_study_report,
)
from .running import (
    plan_of as plan_of,
    pool_for as pool_for,
    run_study as run_study,
)
from .schema import (
    MAX_RUNS as MAX_RUNS,
    Metric as Metric,
    Study as Study,
    study_schema as study_schema,
)
from .sensitivity_indices import (
    Sensitivity as Sensitivity,
    sensitivity as sensitivity,
)
from .stability_boundary import (
    Boundary as Boundary,
    boundary as boundary,
    loop_delay_margin as loop_delay_margin,
)
from .stability_picture import draw_stability as draw_stability
from .stages import (
    plain_sample as plain_sample,
    rare_estimate as rare_estimate,
    stopping_of as stopping_of,
)
from .stopping import Stopping as Stopping
from .subset import subset_simulation as subset_simulation
from .summary import (
    Group as Group,
    Numbers as Numbers,
    Quantile as Quantile,
    Share as Share,
    Summary as Summary,
    summarise as summarise,
)
from .table import read_table as read_table
