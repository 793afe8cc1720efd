from .closed_loop import (
    ClosedLoop as ClosedLoop,
    close as close,
)
from .collocation import collocated as collocated
from .delay_margins import delay_margin as delay_margin
from .divided_time import (
    OutageBound as OutageBound,
    outage_bound as outage_bound,
)
from .from_control import (
    checked_system as checked_system,
    frequency_response as frequency_response,
    to_control as to_control,
)
from .instability import (
    Verdict as Verdict,
    verdict_of as verdict_of,
)
from .mean_square import (
    MeanSquare as MeanSquare,
    jump_mean_square as jump_mean_square,
    rates_mean_square as rates_mean_square,
)
from .nominal_figures import (
    BEYOND as BEYOND,
    NominalFigures as NominalFigures,
    figures_if_known as figures_if_known,
    nominal_figures_of as nominal_figures_of,
)
from .norm import (
    ROOTS as ROOTS,
    NormResult as NormResult,
    gain_at as gain_at,
    hinf_norm as hinf_norm,
    norm_between as norm_between,
)
from .norm_proof import (
    norm_certificate as norm_certificate,
    norm_proved as norm_proved,
)
from .phase import (
    NotFollowedError as NotFollowedError,
    even_samples as even_samples,
    log_derivative as log_derivative,
    turn_along as turn_along,
)
from .roots import (
    Roots as Roots,
    approximate_roots as approximate_roots,
    characteristic_roots as characteristic_roots,
    distinct as distinct,
    polish as polish,
    spectral_abscissa as spectral_abscissa,
)
from .threads import one_thread as one_thread
from .worst_case_disturbance import (
    WorstCase as WorstCase,
    worst_case as worst_case,
    worst_case_at as worst_case_at,
    worst_case_from_json as worst_case_from_json,
)
from .worst_constant_uncertainty import (
    WorstUncertainty as WorstUncertainty,
    worst_uncertainty as worst_uncertainty,
)
