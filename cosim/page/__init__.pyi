from .packing import (
    LARGEST as LARGEST,
    packed as packed,
    packed_times as packed_times,
    packed_values as packed_values,
    plain as plain,
)
from .render import (
    MAX_BYTES as MAX_BYTES,
    render_page as render_page,
)
from .write import write_page as write_page
