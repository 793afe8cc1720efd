from .description import (
    FmuDescription as FmuDescription,
    describe_fmu as describe_fmu,
)
from .export.archive import deterministic_zip as deterministic_zip
from .export.build import (
    FLAVOUR as FLAVOUR,
    FMI_VERSION as FMI_VERSION,
    build_fmu as build_fmu,
    ensure_all as ensure_all,
    ensure_fmu as ensure_fmu,
)
from .export.catalogue import CATALOGUE as CATALOGUE
from .export.components import component_module as component_module
from .export.controller import (
    Packed as Packed,
    pack_controller as pack_controller,
)
from .export.decimals import round_below as round_below
from .export.fmu_file import (
    Flavour as Flavour,
    Kind as Kind,
)
from .export.native.platforms import (
    PLATFORMS as PLATFORMS,
    platforms_named as platforms_named,
)
from .export.page.loop import loop_scenario as loop_scenario
from .export.plant import (
    PackedPlant as PackedPlant,
    pack_plant as pack_plant,
)
from .export.python.delay_plant import DelayPlant as DelayPlant
from .export.spec import (
    CERTIFICATE as CERTIFICATE,
    ComponentSpec as ComponentSpec,
    Variable as Variable,
)
from .export.units import UNITS as UNITS
from .inspect import (
    Inspection as Inspection,
    inspect_fmu as inspect_fmu,
)
from .inspect.facts import facts as facts
from .inspect.finding import (
    LEVELS as LEVELS,
    printable as printable,
)
from .inspect.run import run_findings as run_findings
from .messages import LogSink as LogSink
from .phase import (
    may_be_set as may_be_set,
    settable as settable,
)
from .port import (
    Port as Port,
    SignalKind as SignalKind,
)
from .slave import (
    FmuSlave as FmuSlave,
    StepResults as StepResults,
)
from .state import State as State
from .values import elements as elements
