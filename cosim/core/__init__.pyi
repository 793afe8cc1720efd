from .arrays import distinct as distinct
from .blas_threads import one_blas_thread as one_blas_thread
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
    format_value as format_value,
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
    AnyPath as AnyPath,
    cache_folder as cache_folder,
    copy_whole as copy_whole,
    not_written as not_written,
    similar_files as similar_files,
    unreadable as unreadable,
    write_whole as write_whole,
    written_beside as written_beside,
)
from .groups import is_inside as is_inside
from .locate import line_of as line_of
from .locks import (
    FOLDERS_HAVE_LOCKS as FOLDERS_HAVE_LOCKS,
    lock_file as lock_file,
    locked_folder as locked_folder,
    remove_left as remove_left,
)
from .made_once import once as once
from .migration import (
    migrate as migrate,
    write_migrated as write_migrated,
)
from .notebook import (
    html_table as html_table,
    matrix_text as matrix_text,
)
from .notices import (
    printable as printable,
    say_at_once as say_at_once,
    say_once as say_once,
)
from .origin import (
    NOWHERE as NOWHERE,
    Copied as Copied,
    Findings as Findings,
    KeyPath as KeyPath,
    Layer as Layer,
    Origin as Origin,
    Values as Values,
    dotted as dotted,
    placed as placed,
)
from .output_places import (
    check_output as check_output,
    check_output_folder as check_output_folder,
    output_place as output_place,
)
from .part import (
    NotNegative as NotNegative,
    Number as Number,
    Part as Part,
    PartType as PartType,
    Positive as Positive,
    Text as Text,
)
from .pictures import (
    axes_or_new as axes_or_new,
    drawing as drawing,
    pyplot as pyplot,
    save_picture as save_picture,
)
from .processes import (
    DEATH_HINTS as DEATH_HINTS,
    death_of as death_of,
    flush_output as flush_output,
    has_foreign_code as has_foreign_code,
    note_foreign_code as note_foreign_code,
    prepare_for_foreign_code as prepare_for_foreign_code,
    private_memory as private_memory,
    uninterrupted as uninterrupted,
)
from .progress import (
    Progress as Progress,
    report as report,
    reported_to as reported_to,
    silent as silent,
    still_working as still_working,
)
from .quantity import (
    ANGLE as ANGLE,
    NUMBER as NUMBER,
    NUMBER_ONLY as NUMBER_ONLY,
    TIME as TIME,
    UNIT as UNIT,
    Dimension as Dimension,
    Quantity as Quantity,
    QuantityError as QuantityError,
    Seconds as Seconds,
    check_dimension as check_dimension,
    dimension as dimension,
    parse_quantity as parse_quantity,
    quantity_in as quantity_in,
    seconds as seconds,
    unit_in as unit_in,
)
from .rounding import (
    at_least as at_least,
    at_most as at_most,
)
from .schema_errors import (
    all_refusals as all_refusals,
    number_in_quotes as number_in_quotes,
    refusals as refusals,
    valid as valid,
    validated as validated,
)
from .surroundings import Surroundings as Surroundings
from .toml_text import parse_toml as parse_toml
from .worker import (
    MOST_LINES as MOST_LINES,
    FrameError as FrameError,
    Frames as Frames,
    Method as Method,
    Output as Output,
    RaisedError as RaisedError,
    SharedMemory as SharedMemory,
    Waiting as Waiting,
    Worker as Worker,
    default_method as default_method,
)
