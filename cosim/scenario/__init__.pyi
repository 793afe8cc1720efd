from .channels import (
    link_of as link_of,
    nanoseconds as nanoseconds,
)
from .check import problems_of as problems_of
from .conduct import conduct as conduct
from .demo import (
    Demo as Demo,
    demonstrate as demonstrate,
)
from .diagram import (
    as_mermaid as as_mermaid,
    as_text as as_text,
)
from .dotted import (
    inside as inside,
    kind_of as kind_of,
    put as put,
    split as split,
)
from .editor import json_schema as json_schema
from .execute import (
    Prepared as Prepared,
    check_room as check_room,
    fly as fly,
    fly_unrecorded as fly_unrecorded,
    prepare as prepare,
)
from .extend import (
    give_way as give_way,
    open_source as open_source,
)
from .fields import NAME_PATTERN as NAME_PATTERN
from .gain import (
    Problem as Problem,
    gain_parameters as gain_parameters,
    is_file as is_file,
    problem_about as problem_about,
    problem_of as problem_of,
)
from .hangar import Hangar as Hangar
from .locate import line_of as line_of
from .opening import (
    open_session as open_session,
    run as run,
)
from .outcome import Outcome as Outcome
from .pinned import (
    design_content as design_content,
    named_design as named_design,
)
from .read import (
    LoadedScenario as LoadedScenario,
    builtin_names as builtin_names,
    load as load,
    parse as parse,
    read_text as read_text,
    validated as validated,
    with_settings as with_settings,
)
from .schema import Scenario as Scenario
from .ssp.export import (
    Exported as Exported,
    export_ssp as export_ssp,
)
from .ssp.importing import (
    Imported as Imported,
    import_ssp as import_ssp,
)
from .template import template as template
