from .arithmetic import (
    compute as compute,
    evaluate as evaluate,
)
from .print_c import (
    run_constants as run_constants,
    statements as statements,
)
from .record import (
    FIXED as FIXED,
    OPERATIONS as OPERATIONS,
    VARYING as VARYING,
    Functions as Functions,
    Operation as Operation,
    Scalar as Scalar,
    Tape as Tape,
    required_places as required_places,
)
from .tangent import tangents as tangents
