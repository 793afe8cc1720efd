from .blocks import (
    Blocks as Blocks,
    blocks_from as blocks_from,
)
from .characteristic_roots import CharacteristicRoots as CharacteristicRoots
from .delay_lti import (
    DelayLTI as DelayLTI,
    append as append,
    dead_time as dead_time,
    exp as exp,
    feedback as feedback,
    lti as lti,
    parallel as parallel,
    series as series,
)
from .frequency import (
    FrequencyResponse as FrequencyResponse,
    Nyquist as Nyquist,
)
from .margins import Margins as Margins
from .time_response import TimeResponse as TimeResponse
