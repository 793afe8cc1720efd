from .adjustments import Adjustment as Adjustment
from .checks import LINK_STATE as LINK_STATE, check_ends as check_ends
from .communication_schedule import (
    CommunicationSchedule as CommunicationSchedule,
    Link as Link,
    make_schedule as make_schedule,
)
from .compiled import (
    compiled_delivery as compiled_delivery,
    load_kernel as load_kernel,
)
from .component_instance import (
    ComponentInstance as ComponentInstance,
    element_names as element_names,
)
from .engine import (
    EngineChoice as EngineChoice,
    EngineName as EngineName,
)
from .guards import NOT_WATCHED as NOT_WATCHED, Guards as Guards
from .observers import Observer as Observer
from .order import receiving_order as receiving_order
from .pacing import Pace as Pace, PaceFigures as PaceFigures
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
from .reserved import Reserved as Reserved
from .routes import Route as Route
from .run import (
    Run as Run,
    RunStatus as RunStatus,
)
from .session import (
    Session as Session,
    simulate as simulate,
)
from .session_base import (
    SessionBase as SessionBase,
    error_of as error_of,
    one_thread_at_a_time as one_thread_at_a_time,
)
from .snapshot import Snapshot as Snapshot
from .supervision import (
    BROKEN as BROKEN,
    OVERDUE as OVERDUE,
    AskedError as AskedError,
    BrokenOffError as BrokenOffError,
    Calls as Calls,
    FollowedSession as FollowedSession,
    Limits as Limits,
    SessionState as SessionState,
    Supervisor as Supervisor,
)
from .system import System as System
