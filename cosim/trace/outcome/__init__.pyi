from .assertions import (
    AssertionResult as AssertionResult,
    Result as Result,
)
from .cause import (
    Cause as Cause,
    CauseKind as CauseKind,
)
from .feedback_age import (
    age_lines as age_lines,
    measurement_age_lines as measurement_age_lines,
)
from .outages import (
    outage_rows as outage_rows,
    outage_verdict as outage_verdict,
)
from .run_events import (
    BURST as BURST,
    CONCLUSION as CONCLUSION,
    SERIOUS as SERIOUS,
    EventCount as EventCount,
    EventKind as EventKind,
    RunEvent as RunEvent,
)
from .run_figures import (
    duration_words as duration_words,
    key_figures as key_figures,
)
from .run_outcome import outcome_of as outcome_of
from .verdict import (
    answer_of as answer_of,
    assumptions_of as assumptions_of,
    departures_text as departures_text,
    ended_of as ended_of,
    facts_of as facts_of,
    guarantee_of as guarantee_of,
)
