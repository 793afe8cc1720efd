from .arrays import distinct as distinct
from .descriptions import with_field_docs as with_field_docs
from .errors import (
    CheckFailedError as CheckFailedError,
    ComponentError as ComponentError,
    ContradictionError as ContradictionError,
    CosimError as CosimError,
    InputError as InputError,
    LossError as LossError,
    NotAchievableError as NotAchievableError,
    StoppedError as StoppedError,
    TerminatedError as TerminatedError,
    counted as counted,
    did_you_mean as did_you_mean,
    nearest as nearest,
)
from .extras import optional as optional
from .facts import Fact as Fact
from .file_kinds import (
    DESIGN_FILE as DESIGN_FILE,
    PLANT_NOTE as PLANT_NOTE,
    SCENARIO_FILE as SCENARIO_FILE,
    SCHEMA as SCHEMA,
    STUDY_FILE as STUDY_FILE,
    SYSTEM_FILE as SYSTEM_FILE,
    VEHICLE_FILE as VEHICLE_FILE,
    FileKind as FileKind,
    kind_by_keys as kind_by_keys,
)
from .files import (
    cache_folder as cache_folder,
    copy_whole as copy_whole,
    output_place as output_place,
    similar_files as similar_files,
    unreadable as unreadable,
    write_whole as write_whole,
    written_beside as written_beside,
)
from .locks import has_locks as has_locks, lock_file as lock_file
from .migration import (
    migrate as migrate,
    write_migrated as write_migrated,
)
from .notebook import (
    html_table as html_table,
    matrix_text as matrix_text,
)
from .notices import say_once as say_once
from .processes import (
    DEATH_HINTS as DEATH_HINTS,
    death_of as death_of,
    flush_output as flush_output,
    prepare_for_foreign_code as prepare_for_foreign_code,
    private_memory as private_memory,
)
from .progress import (
    Progress as Progress,
    report as report,
    reported_to as reported_to,
    silent as silent,
)
from .rounding import (
    at_least as at_least,
    at_most as at_most,
)
from .toml_text import parse_toml as parse_toml
