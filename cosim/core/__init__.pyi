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
from .files import write_whole as write_whole
from .progress import (
    Progress as Progress,
    silent as silent,
)
