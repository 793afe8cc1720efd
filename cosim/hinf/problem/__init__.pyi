from .affine_dual import AFFINE as AFFINE
from .auv import (
    DEFAULT_ENVELOPE as DEFAULT_ENVELOPE,
    DEFAULT_K1 as DEFAULT_K1,
    DEFAULT_K2 as DEFAULT_K2,
    AuvDesignSettings as AuvDesignSettings,
    auv_system as auv_system,
)
from .design_constraints import (
    DesignConstraints as DesignConstraints,
    design_constraints_of as design_constraints_of,
)
from .envelope import (
    Envelope as Envelope,
    Scaling as Scaling,
    auv_uncertainty as auv_uncertainty,
    quadratic_part as quadratic_part,
)
from .feedback_structure import (
    refuse_structure as refuse_structure,
    states_of as states_of,
    with_integral as with_integral,
    with_measured as with_measured,
    without_integrals as without_integrals,
)
from .filters import (
    Filter as Filter,
    filtered as filtered,
)
from .jacobians import (
    change_of as change_of,
    jacobian as jacobian,
    mean_jacobian as mean_jacobian,
)
from .linear_enclosure import (
    Box as Box,
    LinearEnclosure as LinearEnclosure,
    enclose as enclose,
)
from .measurements import (
    ObserverSettings as ObserverSettings,
    fed_back as fed_back,
)
from .modem import (
    SOUND_SPEED as SOUND_SPEED,
    Modem as Modem,
)
from .other_delays import (
    DELAY_LIMIT as DELAY_LIMIT,
    ages_are_known as ages_are_known,
    of_any_age as of_any_age,
    with_ages as with_ages,
    with_delay as with_delay,
    with_delays as with_delays,
    without_uncertainty as without_uncertainty,
)
from .system_file import system_schema as system_schema
from .system_toml import (
    BUILT_IN_SYSTEMS as BUILT_IN_SYSTEMS,
    Delay as Delay,
    DelaySystem as DelaySystem,
    NamedSystem as NamedSystem,
    load_system as load_system,
    system_by_name as system_by_name,
    system_from_toml as system_from_toml,
    unknown_system as unknown_system,
)
from .weights import weighted as weighted
