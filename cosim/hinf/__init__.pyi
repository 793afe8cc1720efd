from . import (
    certificate as certificate,
    delay_lti as delay_lti,
    problem as problem,
    synthesis as synthesis,
)
from .certificate import (
    CertificateCheck as CertificateCheck,
    check_certificate as check_certificate,
)
from .delay_lti import (
    DelayLTI as DelayLTI,
    characteristic_roots as characteristic_roots,
    delay_margin as delay_margin,
    hinf_norm as hinf_norm,
    lti as lti,
    spectral_abscissa as spectral_abscissa,
)
from .problem import (
    Delay as Delay,
    DelaySystem as DelaySystem,
    DesignConstraints as DesignConstraints,
    auv_system as auv_system,
    system_by_name as system_by_name,
)
from .synthesis import (
    GreatestDelay as GreatestDelay,
    MessageAges as MessageAges,
    Result as Result,
    analyse as analyse,
    as_cvxpy as as_cvxpy,
    certified_delay as certified_delay,
    design as design,
    design_output_feedback as design_output_feedback,
    greatest_delay as greatest_delay,
    message_ages as message_ages,
)
