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
    eps_by_name as eps_by_name,
    gamma_by_name as gamma_by_name,
    separated as separated,
)
from .outages import (
    Modes as Modes,
    minus_phi_of_outages as minus_phi_of_outages,
    outage_inequalities as outage_inequalities,
    positive_of_outages as positive_of_outages,
    varies as varies,
)
from .theorem_2 import (
    ExactVariables as ExactVariables,
    Scalars as Scalars,
    Shift as Shift,
    longest_delay as longest_delay,
    minus_omega as minus_omega,
    minus_omega_of_scalars as minus_omega_of_scalars,
    positive as positive,
    rates_from_rows as rates_from_rows,
)
