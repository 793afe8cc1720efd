from .ages_of_messages import (
    AgeLimit as AgeLimit,
    AgeRow as AgeRow,
    Assumption as Assumption,
    MessageAges as MessageAges,
    message_ages as message_ages,
)
from .alternatives import with_alternatives_to as with_alternatives_to
from .analysis import analyse as analyse, preferred as preferred
from .any_age_proofs import (
    for_any_command as for_any_command,
    proved_again as proved_again,
)
from .certified_delays import certified_delay as certified_delay
from .cvxpy_lmi import (
    CvxpyLmi as CvxpyLmi,
    as_cvxpy as as_cvxpy,
)
from .damped_gains import greatest_ratio as greatest_ratio
from .decay_search import proved_decay as proved_decay
from .delay_result import GreatestDelay as GreatestDelay
from .delay_routes import delay_by_theorem_2 as delay_by_theorem_2
from .descent import proposals as proposals
from .designs import quickly_proved as quickly_proved
from .gain_design import (
    design as design,
    nominal_gamma as nominal_gamma,
)
from .gain_size import gain_remark as gain_remark
from .greatest_delays import greatest_delay as greatest_delay
from .ladder import (
    clearly_below as clearly_below,
    first_proved as first_proved,
    least_proved as least_proved,
    levels_above as levels_above,
)
from .loop_gain import LoopGain as LoopGain
from .nonsmooth import minimised as minimised
from .outage_rates import (
    certified_outages as certified_outages,
    with_outages as with_outages,
)
from .output_feedback import (
    TooUncertainError as TooUncertainError,
    design_output_feedback as design_output_feedback,
)
from .pair_gain import PairGain as PairGain
from .result import Result as Result
from .search import (
    least_gamma as least_gamma,
    starts as starts,
)
from .stabilisability import unstabilisable_root as unstabilisable_root
from .structured_gains import descent_design as descent_design
from .theorem_2_gamma import checked_scalars as checked_scalars
