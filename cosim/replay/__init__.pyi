from .carried import (
    Carried as Carried,
    certificate_in as certificate_in,
)
from .inject import (
    Injected as Injected,
    inject as inject,
)
from .mapping import Wanted as Wanted
from .order import Order as Order
from .rerun import (
    Rerun as Rerun,
    rerun as rerun,
)
