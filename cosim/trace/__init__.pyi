from .checks.verification import (
    Verification as Verification,
    verify as verify,
)
from .citation import cite as cite
from .comparison.signals import (
    Diff as Diff,
    diff as diff,
)
from .comparison.tolerance import Tolerances as Tolerances
from .content import (
    begins_with as begins_with,
    content_hash as content_hash,
    same_content as same_content,
)
from .exports.export import export as export
from .info import describe as describe
from .info_view import render as render
from .outcome.run_outcome import RunOutcome as RunOutcome
from .picture import (
    LabelledTrace as LabelledTrace,
    compare_runs as compare_runs,
)
from .reader import Trace as Trace
from .recorded_rows import Recorded as Recorded
from .recovery import (
    Recovery as Recovery,
    recover as recover,
)
from .rows.layout import Signal as Signal
from .rows.rows import (
    Lines as Lines,
    Poses as Poses,
    Rows as Rows,
)
from .rows_in_memory import RowsInMemory as RowsInMemory
from .tables.table import (
    Series as Series,
    Table as Table,
)
from .tables.topic_info import TopicInfo as TopicInfo
from .traces import Traces as Traces
from .writer import (
    Attachment as Attachment,
    TraceWriter as TraceWriter,
)
