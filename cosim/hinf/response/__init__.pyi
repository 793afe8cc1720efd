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
from .time_response import TimeResponse as TimeResponse
from .to_models import to_control as to_control
