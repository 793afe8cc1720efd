from .checks.verification import (
    Verification as Verification,
    verify as verify,
)
from .citation import cite as cite
from .comparison.comparison_picture import draw_diff as draw_diff
from .comparison.format import (
    diff_json as diff_json,
    diff_verdict as diff_verdict,
    differences as differences,
    further_differences as further_differences,
)
from .comparison.signals import (
    Diff as Diff,
    diff as diff,
)
from .comparison.tolerance import (
    Tolerance as Tolerance,
    Tolerances as Tolerances,
)
from .content import (
    begins_with as begins_with,
    content_hash as content_hash,
    same_content as same_content,
)
from .exports.export import (
    WrittenTable as WrittenTable,
    export as export,
)
from .info import describe as describe
from .info_view import render as render
from .live import (
    Player as Player,
    view_in_rerun as view_in_rerun,
)
from .outcome.assertions import (
    AssertionResult as AssertionResult,
    Result as Result,
)
from .outcome.cause import (
    Cause as Cause,
    CauseKind as CauseKind,
)
from .outcome.feedback_age import (
    age_lines as age_lines,
    measurement_age_lines as measurement_age_lines,
)
from .outcome.outages import (
    outage_rows as outage_rows,
    outage_verdict as outage_verdict,
)
from .outcome.run_events import (
    CONCLUSION as CONCLUSION,
    SERIOUS as SERIOUS,
    EventCount as EventCount,
    EventKind as EventKind,
    RunEvent as RunEvent,
)
from .outcome.run_outcome import (
    RunOutcome as RunOutcome,
    outcome_of as outcome_of,
)
from .outcome.verdict import (
    assumptions_of as assumptions_of,
    departures_text as departures_text,
    facts_of as facts_of,
    guarantee_of as guarantee_of,
)
from .picture import (
    LabelledTrace as LabelledTrace,
    compare_runs as compare_runs,
    pyplot as pyplot,
    save_picture as save_picture,
)
from .reader import Trace as Trace
from .recovery import (
    Recovery as Recovery,
    recover as recover,
)
from .report import (
    ComparisonReport as ComparisonReport,
    Report as Report,
    write_comparison as write_comparison,
    write_report as write_report,
)
from .ros2 import (
    WrittenBag as WrittenBag,
    export_bag as export_bag,
)
from .rows.hold import rows_in_force as rows_in_force
from .rows.layout import (
    CERTIFICATE_ATTACHMENT as CERTIFICATE_ATTACHMENT,
    CERTIFICATE_HASH as CERTIFICATE_HASH,
    COMPUTED as COMPUTED,
    DESIGN_ATTACHMENT as DESIGN_ATTACHMENT,
    DROPPED_SIGNALS as DROPPED_SIGNALS,
    GREATEST_AGE as GREATEST_AGE,
    LINK_STATE_SCHEMA as LINK_STATE_SCHEMA,
    LINK_STATE_SIGNALS as LINK_STATE_SIGNALS,
    MODE_SIGNALS as MODE_SIGNALS,
    RESULT as RESULT,
    SCENARIO_ATTACHMENT as SCENARIO_ATTACHMENT,
    VEHICLE as VEHICLE,
    Signal as Signal,
    certificate_entries as certificate_entries,
    component_of as component_of,
    dropped_topic as dropped_topic,
    input_topic as input_topic,
    link_state_topic as link_state_topic,
    link_topic as link_topic,
    modes_topic as modes_topic,
    output_topic as output_topic,
    result_of_link as result_of_link,
)
from .rows.rows import (
    Lines as Lines,
    Poses as Poses,
    Rows as Rows,
)
from .rows.scene import Thinned as Thinned
from .tables.table import (
    Table as Table,
    series_of as series_of,
)
from .tables.traffic import link_names as link_names
from .traces import Traces as Traces
from .viewers import (
    Viewer as Viewer,
    WrittenLayout as WrittenLayout,
    write_layout as write_layout,
)
from .writer import (
    Attachment as Attachment,
    TraceWriter as TraceWriter,
)
