from .delay_fit import DelayModel as DelayModel
from .fit import (
    LinkFit as LinkFit,
    fit_link as fit_link,
)
from .hidden_chain import HiddenChain as HiddenChain
from .identified import Parameter as Parameter
from .link_verdict import (
    OutageVerdict as OutageVerdict,
    outage_verdict as outage_verdict,
)
from .loss_fit import LossModel as LossModel
from .picture import draw_recordings as draw_recordings
from .plausibility import Plausibility as Plausibility
from .range_fit import RangeDependence as RangeDependence
from .reading import (
    MOST_ROWS as MOST_ROWS,
    ReadRecording as ReadRecording,
    one_of as one_of,
    read_log as read_log,
    read_recording as read_recording,
    read_recordings as read_recordings,
    write_recordings as write_recordings,
)
from .statistics import (
    OUTAGE as OUTAGE,
    LinkStatistics as LinkStatistics,
    Spread as Spread,
    statistics_of as statistics_of,
)
