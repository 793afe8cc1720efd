from .player import (
    Player as Player,
)
from .rerun_view import (
    ViewResult as ViewResult,
    view_in_rerun as view_in_rerun,
)
