from .binary import (
    ACCEPTED_STATUSES as ACCEPTED_STATUSES,
    SlaveOptions as SlaveOptions,
)
from .call_watch import (
    calling as calling,
    watch_calls as watch_calls,
)
from .description import (
    FmuDescription as FmuDescription,
    describe_fmu as describe_fmu,
)
from .export.build import build_fmu as build_fmu
from .feedthrough import Feedthrough as Feedthrough
from .float_mode import (
    restore_function as restore_function,
    saved_float_mode as saved_float_mode,
)
from .fmu_slave import FmuSlave as FmuSlave
from .instance import require_loadable as require_loadable
from .isolation import SlaveProcess as SlaveProcess
from .port import (
    Port as Port,
    SignalKind as SignalKind,
    describe_settable as describe_settable,
    may_be_set as may_be_set,
)
from .python_code import (
    Component as Component,
    code_of as code_of,
)
from .returned import (
    LEAST_INTERVAL as LEAST_INTERVAL,
    Returned as Returned,
    exactly as exactly,
)
from .state import FmuState as FmuState
from .terminal import Terminal as Terminal
from .unit_base import UnitBase as UnitBase
from .unpacking import (
    adopt_folder as adopt_folder,
    own_folder as own_folder,
    unpack_fmu as unpack_fmu,
)
from .values import checked_scalars as checked_scalars
