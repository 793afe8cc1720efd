from .figures import (
    curves as curves,
    figure_rows as figure_rows,
)
from .for_every_delay import every_delay as every_delay
from .greatest_delays import (
    table_2 as table_2,
    table_rows as table_rows,
)
from .html_page import page as page
from .lemmas import lemma_rows as lemma_rows
from .misprints import (
    COUNTEREXAMPLES as COUNTEREXAMPLES,
    misprint_rows as misprint_rows,
)
from .model import model_rows as model_rows
from .report import (
    Report as Report,
    reproduce as reproduce,
)
from .row import (
    SECTIONS as SECTIONS,
    How as How,
    Row as Row,
    Verdict as Verdict,
)
from .simulation import simulate as simulate
from .theorem_1 import theorem_1_rows as theorem_1_rows
from .theorem_2 import theorem_2_rows as theorem_2_rows
from .view import paper_view as paper_view
