from .html_page import page as page
from .report import (
    Report as Report,
    reproduce as reproduce,
)
from .row import (
    How as How,
    Row as Row,
    Verdict as Verdict,
)
from .view import paper_view as paper_view
