from .condition import (
    Condition as Condition,
)
from .conic import (
    Constraint as Constraint,
    Solution as Solution,
    solve as solve,
)
from .constrained_problem import ConstrainedProblem as ConstrainedProblem
from .cvxpy_form import (
    in_cvxpy as in_cvxpy,
    variables_of as variables_of,
)
from .decay_lmi import CornersProblem as CornersProblem
from .gain_lmi import (
    GainLmi as GainLmi,
    Multiplier as Multiplier,
    multiplier_of as multiplier_of,
    scalar_multiplier as scalar_multiplier,
)
from .injection_lmi import InjectionLmi as InjectionLmi
from .loop_units import own_units as own_units
from .margin import widest_margin as widest_margin
from .outage_lmi import OutageLmi as OutageLmi
from .peak_lmi import (
    THETAS as THETAS,
    proved_peak_control as proved_peak_control,
)
from .problem import (
    ROUGH_TOLERANCE as ROUGH_TOLERANCE,
    Answer as Answer,
    Problem as Problem,
    without_performance as without_performance,
)
from .program import Program as Program
from .refutation import refute as refute
from .scaling import (
    Scaling as Scaling,
    check_size as check_size,
    scaling_of as scaling_of,
    units_of as units_of,
)
from .solver_status import (
    FAILED as FAILED,
    OTHER_ROUTES as OTHER_ROUTES,
    OTHER_UNITS as OTHER_UNITS,
    not_found as not_found,
    solver_words as solver_words,
)
from .state_peak_lmi import proved_state_peaks as proved_state_peaks
from .svec import Array as Array
