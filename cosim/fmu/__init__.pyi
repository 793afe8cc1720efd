from .binary import (
    ACCEPTED_STATUSES as ACCEPTED_STATUSES,
    SlaveOptions as SlaveOptions,
)
from .call_watch import (
    calling as calling,
    watch_calls as watch_calls,
)
from .certificate import (
    carries_certificate as carries_certificate,
    certificate_in_fmu as certificate_in_fmu,
    certified_values as certified_values,
)
from .compiled import (
    compiled_library as compiled_library,
    is_prebuilt as is_prebuilt,
    library_source as library_source,
    write_library as write_library,
)
from .description import (
    FmuDescription as FmuDescription,
    describe_fmu as describe_fmu,
)
from .export.build import (
    build_fmu as build_fmu,
    ensure_all as ensure_all,
    ensure_fmu as ensure_fmu,
    ensure_made as ensure_made,
)
from .export.catalogue import CATALOGUE as CATALOGUE
from .export.components import component_module as component_module
from .export.controller import (
    ControllerFmu as ControllerFmu,
    export_controller as export_controller,
)
from .export.design_parts import (
    design_part_spec as design_part_spec,
    design_parts as design_parts,
    ensure_design_fmu as ensure_design_fmu,
)
from .export.deterministic_zip import deterministic_zip as deterministic_zip
from .export.flavours import (
    DEFAULT_FLAVOUR as DEFAULT_FLAVOUR,
    FMI_VERSION as FMI_VERSION,
    Flavour as Flavour,
)
from .export.fmu_file import (
    FmuTarget as FmuTarget,
    checked_name as checked_name,
    model_name as model_name,
    target_named as target_named,
    write_fmu as write_fmu,
)
from .export.native.native_package import (
    KINDS as KINDS,
    write_binary as write_binary,
)
from .export.native.target_platforms import (
    PLATFORMS as PLATFORMS,
    Platform as Platform,
    host as host,
    platforms_named as platforms_named,
)
from .export.page.loop import (
    loop_scenario as loop_scenario,
    round_below as round_below,
)
from .export.plant import (
    PlantFmu as PlantFmu,
    export_plant as export_plant,
)
from .export.python.delay_plant import DelayPlant as DelayPlant
from .export.spec import (
    UNITS as UNITS,
    ComponentSpec as ComponentSpec,
    Variable as Variable,
    solver_step as solver_step,
)
from .feedthrough import Feedthrough as Feedthrough
from .float_mode import (
    restore_function as restore_function,
    saved_float_mode as saved_float_mode,
)
from .fmu_slave import (
    FmuSlave as FmuSlave,
)
from .inspect import (
    Inspection as Inspection,
    inspect_fmu as inspect_fmu,
)
from .inspect.archive import (
    BROKEN_ARCHIVE as BROKEN_ARCHIVE,
    CheckedArchive as CheckedArchive,
)
from .inspect.findings import (
    LEVELS as LEVELS,
    printable as printable,
)
from .inspect.inspection_facts import fmu_facts as fmu_facts
from .inspect.markup import MAX_XML as MAX_XML
from .inspect.rules import (
    GROUPS as GROUPS,
    RULES as RULES,
    Rule as Rule,
    rule_named as rule_named,
)
from .inspect.run import run_findings as run_findings
from .instance import require_loadable as require_loadable
from .isolation import SlaveProcess as SlaveProcess
from .port import (
    Port as Port,
    SignalKind as SignalKind,
    describe_settable as describe_settable,
    may_be_set as may_be_set,
)
from .prebuilt import (
    is_current as is_current,
    prebuilt_folder as prebuilt_folder,
    write_manifest as write_manifest,
)
from .returned import (
    LEAST_INTERVAL as LEAST_INTERVAL,
    Returned as Returned,
    exactly as exactly,
)
from .state import FmuState as FmuState
from .terminal import Terminal as Terminal
from .unpacking import (
    adopt_folder as adopt_folder,
    own_folder as own_folder,
    unpack_fmu as unpack_fmu,
)
from .values import checked_scalars as checked_scalars
