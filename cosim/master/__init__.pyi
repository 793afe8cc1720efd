from .checks import LINK_STATE as LINK_STATE
from .communication_schedule import (
    CommunicationSchedule as CommunicationSchedule,
    Link as Link,
    make_schedule as make_schedule,
)
from .component_instance import (
    ComponentInstance as ComponentInstance,
    element_names as element_names,
)
from .engine import (
    EngineChoice as EngineChoice,
    EngineName as EngineName,
)
from .kernel import load_kernel as load_kernel
from .observers import Observer as Observer
from .order import (
    ReceivingOrder as ReceivingOrder,
    receiving_order as receiving_order,
)
from .pacing import Pace as Pace
from .parts import (
    MODE_NUMBER as MODE_NUMBER,
    Algorithm as Algorithm,
    Component as Component,
    Connection as Connection,
    DelaySource as DelaySource,
    Endpoint as Endpoint,
    LogLevel as LogLevel,
    Modes as Modes,
    Policy as Policy,
    PositionSource as PositionSource,
    UnknownFeedthrough as UnknownFeedthrough,
)
from .recorder import (
    TraceRecorder as TraceRecorder,
    identifier as identifier,
)
from .routes import Route as Route
from .run import (
    Run as Run,
    RunStatus as RunStatus,
)
from .session import (
    Session as Session,
    simulate as simulate,
)
from .snapshot import Snapshot as Snapshot
from .supervision import (
    BROKEN as BROKEN,
    OVERDUE as OVERDUE,
    Calls as Calls,
    Limits as Limits,
    Supervisor as Supervisor,
)
from .supervision.process import default_method as default_method
from .system import System as System
