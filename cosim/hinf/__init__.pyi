from .analysis import (
    Analysis as Analysis,
    analyse as analyse,
)
from .auv import (
    DEFAULT_ENVELOPE as DEFAULT_ENVELOPE,
    DEFAULT_K1 as DEFAULT_K1,
    DEFAULT_K2 as DEFAULT_K2,
    AuvDesignSettings as AuvDesignSettings,
    auv_system as auv_system,
)
from .certificate import (
    certificate_bytes as certificate_bytes,
    certificate_from_bytes as certificate_from_bytes,
    certificate_hash as certificate_hash,
    check_certificate as check_certificate,
    read_certificate as read_certificate,
)
from .certified_delays import (
    CertifiedDelay as CertifiedDelay,
    certified_delay as certified_delay,
)
from .closed_loop import (
    ClosedLoop as ClosedLoop,
    close as close,
)
from .delay_margins import delay_margin as delay_margin
from .design_constraints import (
    DesignConstraints as DesignConstraints,
    design_constraints_of as design_constraints_of,
)
from .design_file import (
    design_from_json as design_from_json,
    design_to_json as design_to_json,
)
from .envelope import Envelope as Envelope
from .exact_lmi import (
    ExactVariables as ExactVariables,
    minus_omega as minus_omega,
)
from .from_control import (
    frequency_response as frequency_response,
    to_control as to_control,
)
from .gain_design import (
    design as design,
    greatest_delay as greatest_delay,
    nominal_gamma as nominal_gamma,
    without_uncertainty as without_uncertainty,
)
from .greatest_delays import (
    DELAY_LIMIT as DELAY_LIMIT,
    GreatestDelay as GreatestDelay,
    with_delays as with_delays,
)
from .guarantees import Guarantees as Guarantees
from .lmi import (
    CvxpyLmi as CvxpyLmi,
    as_cvxpy as as_cvxpy,
)
from .nominal_figures import (
    NominalFigures as NominalFigures,
    nominal_figures_of as nominal_figures_of,
)
from .norm import (
    NormResult as NormResult,
    gain_at as gain_at,
    hinf_norm as hinf_norm,
)
from .norm_proof import norm_proved as norm_proved
from .proof import CertificateCheck as CertificateCheck
from .rational import first_bad_pivot as first_bad_pivot
from .roots import (
    characteristic_roots as characteristic_roots,
    spectral_abscissa as spectral_abscissa,
)
from .synthesis import Design as Design
from .system_json import (
    first_difference as first_difference,
    matrix_from_rows as matrix_from_rows,
    system_from_json as system_from_json,
)
from .system_toml import (
    BUILT_IN_SYSTEMS as BUILT_IN_SYSTEMS,
    Delay as Delay,
    DelaySystem as DelaySystem,
    NamedSystem as NamedSystem,
    parse_toml as parse_toml,
    system_by_name as system_by_name,
)
from .threads import one_thread as one_thread
from .weights import weighted as weighted
from .worst_case_disturbance import (
    WorstCase as WorstCase,
    worst_case as worst_case,
    worst_case_at as worst_case_at,
    worst_case_from_json as worst_case_from_json,
)
