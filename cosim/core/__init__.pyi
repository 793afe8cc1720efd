from .errors import (
    CheckFailedError as CheckFailedError,
    ComponentError as ComponentError,
    CosimError as CosimError,
    InputError as InputError,
    LossError as LossError,
    NotAchievableError as NotAchievableError,
    StoppedError as StoppedError,
    TerminatedError as TerminatedError,
)
from .extras import optional as optional
from .files import (
    copy_whole as copy_whole,
    write_whole as write_whole,
    written_beside as written_beside,
)
from .notebook import (
    html_table as html_table,
    matrix_text as matrix_text,
)
from .processes import (
    DEATH_HINTS as DEATH_HINTS,
    death_of as death_of,
    flush_output as flush_output,
    prepare_for_foreign_code as prepare_for_foreign_code,
    private_memory as private_memory,
)
from .progress import (
    Progress as Progress,
    silent as silent,
)
from .rounding import (
    at_least as at_least,
    at_most as at_most,
)
