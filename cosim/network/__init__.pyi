from . import (
    draws as draws,
    stepping as stepping,
)
from .arrivals import (
    DELIVERED as DELIVERED,
    IN_FLIGHT as IN_FLIGHT,
    LOST as LOST,
    NOT_RECEIVED as NOT_RECEIVED,
    QUEUE_FULL as QUEUE_FULL,
    REASONS as REASONS,
    Arrivals as Arrivals,
)
from .checks import MAX_NS as MAX_NS
from .compiled_delivery import CompiledDelivery as CompiledDelivery
from .delay_signal import DelaySignal as DelaySignal
from .deliveries import (
    begin_deliveries as begin_deliveries,
    deliver as deliver,
)
from .delivery import Delivery as Delivery
from .file_rows import (
    Header as Header,
    Row as Row,
    no_rows as no_rows,
    read_header as read_header,
    read_rows as read_rows,
)
from .impairment import (
    GilbertElliott as GilbertElliott,
    Jitter as Jitter,
    LossChain as LossChain,
    LossWindow as LossWindow,
)
from .keys import (
    ChoiceKey as ChoiceKey,
    CountKey as CountKey,
    DeclaredKey as DeclaredKey,
    DurationKey as DurationKey,
    NumberKey as NumberKey,
    ProbabilitiesKey as ProbabilitiesKey,
    ProbabilityKey as ProbabilityKey,
    TableKey as TableKey,
    TextKey as TextKey,
    WordOrNumberKey as WordOrNumberKey,
    keys_of as keys_of,
)
from .log_format import (
    UNIT_WORDS as UNIT_WORDS,
    Delimiter as Delimiter,
    LogFormat as LogFormat,
    Unit as Unit,
    seconds_in_words as seconds_in_words,
    unit_doubt as unit_doubt,
)
from .medium import (
    SPEED_OF_SOUND as SPEED_OF_SOUND,
    Hop as Hop,
    Medium as Medium,
    Node as Node,
    distance as distance,
)
from .medium_delivery import (
    MediumDelivery as MediumDelivery,
    Traffic as Traffic,
)
from .packet import (
    Order as Order,
    PacketLink as PacketLink,
)
from .profile import (
    DelayProfile as DelayProfile,
    Interpolation as Interpolation,
)
from .range_loss import (
    RangeLogit as RangeLogit,
    RangeTable as RangeTable,
)
from .recording import (
    IN_FLIGHT_NS as IN_FLIGHT_NS,
    Recording as Recording,
)
from .single_draws import (
    single_log as single_log,
    single_uniform as single_uniform,
    standard_normal as standard_normal,
)
from .state import (
    NONE_YET as NONE_YET,
    SUBSTITUTE as SUBSTITUTE,
    LinkState as LinkState,
)
from .transport import TransportLink as TransportLink
