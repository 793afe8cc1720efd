from .build import (
    ensure_all as ensure_all,
    ensure_fmu as ensure_fmu,
    ensure_made as ensure_made,
)
from .catalogue import CATALOGUE as CATALOGUE
from .components import component_module as component_module
from .controller import (
    ControllerFmu as ControllerFmu,
    export_controller as export_controller,
)
from .flavours import (
    DEFAULT_FLAVOUR as DEFAULT_FLAVOUR,
    FMI_VERSION as FMI_VERSION,
    Flavour as Flavour,
)
from .fmu_file import (
    FmuTarget as FmuTarget,
    checked_name as checked_name,
    model_name as model_name,
    target_named as target_named,
    write_fmu as write_fmu,
)
from .native.native_package import (
    KINDS as KINDS,
    write_binary as write_binary,
)
from .native.target_platforms import (
    PLATFORMS as PLATFORMS,
    Platform as Platform,
    host as host,
    platforms_named as platforms_named,
)
from .packed import (
    pack as pack,
    spec_of as spec_of,
)
from .page.loop import (
    loop_scenario as loop_scenario,
    round_below as round_below,
)
from .parts_of_design import (
    design_part_spec as design_part_spec,
    design_parts as design_parts,
    ensure_design_fmu as ensure_design_fmu,
)
from .plant import (
    PlantFmu as PlantFmu,
    export_plant as export_plant,
)
from .python.delay_plant import DelayPlant as DelayPlant
from .spec import (
    UNITS as UNITS,
    ComponentSpec as ComponentSpec,
    Variable as Variable,
    solver_step as solver_step,
)
from .zip_file import deterministic_zip as deterministic_zip
