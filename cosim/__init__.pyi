from .core import CosimError as CosimError
from .core.version import __version__ as __version__
from .fmu import (
    Component as Component,
    build_fmu as build_fmu,
)
from .fmu.export import pack as pack
from .hinf import (
    Delay as Delay,
    DelaySystem as DelaySystem,
    Result as Result,
    analyse as analyse,
    check_certificate as check_certificate,
    design as design,
)
from .models import link as link
from .replay import (
    inject as inject,
    scenario_of as scenario_of,
)
from .scenario import (
    RunResult as RunResult,
    Scenario as Scenario,
    Session as Session,
    env as env,
    open_session as open_session,
    run as run,
    run_async as run_async,
)
from .study import (
    run_study as run_study,
    sweep as sweep,
)
from .trace import (
    Trace as Trace,
    Traces as Traces,
)
