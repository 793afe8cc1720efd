from .asynchronous_run import run_async as run_async
from .binding import (
    BoundExpression as BoundExpression,
    formula as formula,
)
from .built_in import builtin_names as builtin_names
from .channels import link_of as link_of
from .check import (
    problems_of as problems_of,
    problems_of_loaded as problems_of_loaded,
)
from .demo import (
    Demo as Demo,
    demonstrate as demonstrate,
)
from .design_files import design_content as design_content
from .designed_plant import (
    DesignedPlant as DesignedPlant,
    LinearSignals as LinearSignals,
)
from .diagram import (
    as_mermaid as as_mermaid,
    as_text as as_text,
)
from .editor_schema import json_schema as json_schema
from .environments import env as env
from .execute import (
    assembled_system as assembled_system,
    execute_recorded as execute_recorded,
    execute_run as execute_run,
    execute_unrecorded as execute_unrecorded,
)
from .expression import ExpressionError as ExpressionError
from .extend import (
    give_way as give_way,
    open_source as open_source,
)
from .fields import (
    COLUMN_PATTERN as COLUMN_PATTERN,
    NAME_PATTERN as NAME_PATTERN,
    Part as Part,
)
from .fitting import (
    Fitting as Fitting,
    fitting_of as fitting_of,
)
from .fmu_cache import FmuCache as FmuCache
from .gain import (
    Problem as Problem,
    gain_parameters as gain_parameters,
    is_file as is_file,
    problem_about as problem_about,
    problem_of as problem_of,
)
from .guarantee.claim import certified_age as certified_age
from .in_python import Scenario as Scenario
from .interrupt import (
    InterruptedRun as InterruptedRun,
    TerminatedRun as TerminatedRun,
)
from .key_paths import (
    inside as inside,
    kind_of as kind_of,
    put as put,
    split as split,
)
from .link_keys import nanoseconds as nanoseconds
from .lowering import has_signal_parts as has_signal_parts
from .new_from_fmus import (
    NewScenario as NewScenario,
    default_name as default_name,
    is_fmu as is_fmu,
    scenario_from_fmus as scenario_from_fmus,
)
from .outcome import Outcome as Outcome
from .pinned import named_design as named_design
from .plant import parameters_of_plant as parameters_of_plant
from .preparation import (
    MADE_BEFORE as MADE_BEFORE,
    PreparedScenario as PreparedScenario,
    prepare as prepare,
)
from .python_api import (
    open_session as open_session,
    run as run,
)
from .read import (
    LoadedScenario as LoadedScenario,
    load as load,
    parse as parse,
    read_text as read_text,
    with_settings as with_settings,
)
from .run_limits import (
    parse_limits as parse_limits,
    time_limit as time_limit,
)
from .run_result import RunResult as RunResult
from .run_series import RunSeries as RunSeries
from .scenario_session import ScenarioSession as ScenarioSession
from .schema import ScenarioPart as ScenarioPart
from .session_in_python import Session as Session
from .ssp.export import (
    SspExport as SspExport,
    export_ssp as export_ssp,
)
from .ssp.importing import (
    SspImport as SspImport,
    import_ssp as import_ssp,
)
from .ssp.names import SspVersion as SspVersion
from .ssp.ssp_check import (
    SspCheck as SspCheck,
    check_ssp as check_ssp,
)
from .step_check import (
    StepCheck as StepCheck,
    check_step as check_step,
)
from .supervised_session import SupervisedSession as SupervisedSession
from .supervision import (
    Supervision as Supervision,
    supervision_of as supervision_of,
)
from .system_run import run_system as run_system
from .templates import template as template
from .wanted import (
    ALL_FIGURES as ALL_FIGURES,
    Wanted as Wanted,
)
