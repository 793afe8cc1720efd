from .ages import (
    NOT_SYMMETRIC as NOT_SYMMETRIC,
    UNKNOWNS as UNKNOWNS,
    Age as Age,
    age_inequalities as age_inequalities,
    corners_of as corners_of,
    minus_phi as minus_phi,
    positive_of_ages as positive_of_ages,
    shapes_of_ages as shapes_of_ages,
    subtract_derivative as subtract_derivative,
    widest_functional as widest_functional,
)
from .ages_theorem import (
    MAX_BOX as MAX_BOX,
    MAX_CORNERS as MAX_CORNERS,
    MAX_ORDER as MAX_ORDER,
    AgesTheorem as AgesTheorem,
    constants_down_to_zero as constants_down_to_zero,
    functionals_of as functionals_of,
    supports_of as supports_of,
)
from .design import minus_phi_of_design as minus_phi_of_design
from .farkas import (
    farkas_failure as farkas_failure,
    products as products,
)
from .inequality import (
    Inequality as Inequality,
    Shape as Shape,
    Signal as Signal,
    Sum as Sum,
    Term as Term,
    Weight as Weight,
    first_failure as first_failure,
    itself as itself,
    number_itself as number_itself,
    shapes_of as shapes_of,
    stack as stack,
    value_of as value_of,
)
from .loop import (
    Loop as Loop,
    Support as Support,
    Supports as Supports,
    positive_delays as positive_delays,
)
from .outages import (
    Modes as Modes,
    minus_phi_of_outages as minus_phi_of_outages,
    outage_inequalities as outage_inequalities,
    positive_of_outages as positive_of_outages,
    varies as varies,
)
from .proof import (
    Proof as Proof,
    Theorem as Theorem,
    exact_unknowns as exact_unknowns,
    not_symmetric as not_symmetric,
    require_size as require_size,
    with_inverse_of_gamma as with_inverse_of_gamma,
)
from .theorem_2 import (
    Scalars as Scalars,
    Shift as Shift,
    Theorem2 as Theorem2,
    longest_delay as longest_delay,
    minus_omega as minus_omega,
    minus_omega_of_scalars as minus_omega_of_scalars,
    positive as positive,
    rates_from_rows as rates_from_rows,
)
