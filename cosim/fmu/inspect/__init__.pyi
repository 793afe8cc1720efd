from .archive import (
    BROKEN_ARCHIVE as BROKEN_ARCHIVE,
    CheckedArchive as CheckedArchive,
)
from .findings import (
    LEVELS as LEVELS,
    printable as printable,
)
from .fmu_certificate import (
    carries_certificate as carries_certificate,
    certificate_in_fmu as certificate_in_fmu,
    certified_values as certified_values,
)
from .inspection import (
    Inspection as Inspection,
    inspect_fmu as inspect_fmu,
)
from .inspection_facts import fmu_facts as fmu_facts
from .markup import MAX_XML as MAX_XML
from .rules import (
    GROUPS as GROUPS,
    RULES as RULES,
    Rule as Rule,
    rule_named as rule_named,
)
from .run import run_findings as run_findings
