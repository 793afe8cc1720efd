from . import (
    paper_example as paper_example,
    waves as waves,
)
from .assumptions import (
    greatest_share as greatest_share,
    share_of_age as share_of_age,
    watch as watch,
)
from .auv import (
    STATE as STATE,
    TABLE_1 as TABLE_1,
    hydrodynamic_force as hydrodynamic_force,
    inertia as inertia,
    kinematics as kinematics,
    thrust_map as thrust_map,
    vehicle_conditions as vehicle_conditions,
    vehicle_derivatives as vehicle_derivatives,
    velocity_coefficients as velocity_coefficients,
)
from .delay_line import DelayLine as DelayLine
from .delay_system import (
    Delay as Delay,
    DelaySystem as DelaySystem,
    Feedback as Feedback,
    Matrix as Matrix,
    link as link,
)
from .delayed_linear import (
    linear_derivatives as linear_derivatives,
    linear_output as linear_output,
)
from .feedback import (
    clamped_command as clamped_command,
    feedback_command as feedback_command,
    integrals_after as integrals_after,
)
from .measurement import (
    Measurement as Measurement,
    Over as Over,
)
from .observer import (
    EstimateLine as EstimateLine,
    acting_control as acting_control,
    innovation as innovation,
)
from .products import (
    product as product,
    total as total,
)
from .values import (
    Value as Value,
    read_only as read_only,
)
from .vehicle import (
    FloatFunctions as FloatFunctions,
    VehicleEquations as VehicleEquations,
)
from .vehicle_actuators import effect_of as effect_of
from .vehicle_forces import (
    Derivative as Derivative,
    derivative_named as derivative_named,
)
from .vehicle_inertia import (
    FORCES as FORCES,
    VELOCITIES as VELOCITIES,
    axes_of as axes_of,
)
from .waves import (
    GRAVITY as GRAVITY,
    Component as Component,
    Gains as Gains,
    accelerations as accelerations,
    at_depth as at_depth,
    gains as gains,
    sea as sea,
)
