from .inspection import (
    Inspection as Inspection,
    inspect_fmu as inspect_fmu,
)
