from .ages_certificate import (
    loop_claim as loop_claim,
    loop_to_json as loop_to_json,
)
from .ages_json import analysis_from_json as analysis_from_json
from .certificate import (
    certificate_bytes as certificate_bytes,
    certificate_from_bytes as certificate_from_bytes,
    certificate_hash as certificate_hash,
    check_certificate as check_certificate,
    read_certificate as read_certificate,
)
from .claim import (
    CertificateCheck as CertificateCheck,
    claim_of as claim_of,
    covers_smaller as covers_smaller,
)
from .constant_ages import (
    constant_ages_claimed as constant_ages_claimed,
    has_constant_age as has_constant_age,
    remark_on_ages as remark_on_ages,
    reproving_command as reproving_command,
)
from .control_limits import (
    MAX_OFFSETS as MAX_OFFSETS,
    GainLimit as GainLimit,
    PeakControl as PeakControl,
    half_of_corners as half_of_corners,
    norm_above as norm_above,
    offset_corners as offset_corners,
    peak_system as peak_system,
    proved_peaks as proved_peaks,
    too_many_offsets as too_many_offsets,
)
from .damping import (
    Damping as Damping,
    checked_damping as checked_damping,
)
from .decay import (
    Decay as Decay,
    acting_delays as acting_delays,
    corners as corners,
    growth_of as growth_of,
    is_above_exponential as is_above_exponential,
)
from .document import (
    Certificate as Certificate,
    claim_words as claim_words,
    theorem_rows as theorem_rows,
)
from .guarantees import (
    KEY as KEY,
    Guarantees as Guarantees,
    guarantees_from_json as guarantees_from_json,
)
from .norm_certificate import norm_to_json as norm_to_json
from .norm_proof import (
    MAX_STEPS as MAX_STEPS,
    NORM_BITS as NORM_BITS,
    NormPoint as NormPoint,
    NormProof as NormProof,
    bend as bend,
    exact_terms as exact_terms,
)
from .observer_pair import (
    ObserverPair as ObserverPair,
    checked_measurements as checked_measurements,
    exact_noise as exact_noise,
    pair_of as pair_of,
)
from .outage_guarantee import (
    Outages as Outages,
    outage_delay as outage_delay,
    shapes_of_outages as shapes_of_outages,
)
from .output_feedback_certificate import (
    measurement_differences as measurement_differences,
    output_feedback_to_json as output_feedback_to_json,
    pair_from_json as pair_from_json,
)
from .refutation_certificate import (
    gamma_floor as gamma_floor,
    refutation_to_json as refutation_to_json,
)
from .refutation_proof import (
    Place as Place,
    conditions as conditions,
    fixed_at as fixed_at,
    refutation_failure as refutation_failure,
)
from .state_peaks import (
    StatePeaks as StatePeaks,
    bounds_above as bounds_above,
    check_peaks_asked as check_peaks_asked,
    squared_state_peaks as squared_state_peaks,
)
from .system_json import (
    check_measured as check_measured,
    differences as differences,
    first_difference as first_difference,
    gain_from_json as gain_from_json,
    known_keys as known_keys,
    system_from_json as system_from_json,
    system_to_json as system_to_json,
)
from .system_parts import (
    MATRICES as MATRICES,
    DelayPart as DelayPart,
    Double as Double,
    MaybeDouble as MaybeDouble,
    MaybeRows as MaybeRows,
    MeasurementPart as MeasurementPart,
    Numbers as Numbers,
    Rows as Rows,
    Seconds as Seconds,
    SystemPart as SystemPart,
    counted_as as counted_as,
    fitted as fitted,
    matrix_from_rows as matrix_from_rows,
    number as number,
)
from .theorem_2_certificate import (
    certificate_to_json as certificate_to_json,
    theorem_2_proof as theorem_2_proof,
)
from .words import (
    AGE_FROM as AGE_FROM,
    PROPERTIES as PROPERTIES,
    AgeWord as AgeWord,
    theorem_of as theorem_of,
    uncertainty_text as uncertainty_text,
)
