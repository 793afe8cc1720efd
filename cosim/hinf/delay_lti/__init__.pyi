from .blocks import (
    Blocks as Blocks,
    Reals as Reals,
    balanced_blocks as balanced_blocks,
    beside as beside,
    blocks_from as blocks_from,
    from_inputs as from_inputs,
)
from .closed_loop import (
    ClosedLoop as ClosedLoop,
    checked_system as checked_system,
    close as close,
)
from .delay_lti import (
    DelayLTI as DelayLTI,
    append as append,
    dead_time as dead_time,
    exp as exp,
    feedback as feedback,
    lti as lti,
    parallel as parallel,
    series as series,
)
from .delay_margins import delay_margin as delay_margin, margin_of_delay as margin_of_delay
from .divided_time import (
    OutageBound as OutageBound,
    outage_bound as outage_bound,
)
from .frequency import (
    FrequencyResponse as FrequencyResponse,
    Nyquist as Nyquist,
    frequency_response as frequency_response,
    frequency_response_of as frequency_response_of,
    nyquist_of as nyquist_of,
)
from .instability import (
    Verdict as Verdict,
    verdict_of as verdict_of,
)
from .margins import (
    Margins as Margins,
    margins_of as margins_of,
)
from .mean_square import (
    MeanSquare as MeanSquare,
    jump_mean_square as jump_mean_square,
    rates_mean_square as rates_mean_square,
)
from .nominal_figures import (
    BEYOND as BEYOND,
    HasFigures as HasFigures,
    NominalFigures as NominalFigures,
    figures_if_known as figures_if_known,
    nominal_figures_of as nominal_figures_of,
)
from .norm import (
    ROOTS as ROOTS,
    NormResult as NormResult,
    gain_at as gain_at,
    hinf_norm as hinf_norm,
    norm_of as norm_of,
)
from .norm_intervals import (
    norm_certificate as norm_certificate,
    norm_proved as norm_proved,
    norm_proved_of as norm_proved_of,
)
from .pictures import draw_time as draw_time
from .retarded import plain_of as plain_of
from .root_array import CharacteristicRoots as CharacteristicRoots
from .roots import (
    Roots as Roots,
    approximate_roots as approximate_roots,
    characteristic_roots as characteristic_roots,
    is_stable as is_stable,
    roots_of as roots_of,
    roots_right_of as roots_right_of,
    spectral_abscissa as spectral_abscissa,
)
from .threads import one_thread as one_thread
from .time_response import TimeResponse as TimeResponse
from .to_models import to_control as to_control
from .winding import winding_of as winding_of
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
