"""H-infinity design over delays: the LMI, the exact proof, the exact yardsticks."""

from cosim.hinf.analysis import Analysis, analyse
from cosim.hinf.auv import AuvDesign, auv_system
from cosim.hinf.by_order import greatest_delay
from cosim.hinf.canonical import certificate_bytes, certificate_hash
from cosim.hinf.certificate import Certificate, check_certificate, read_certificate
from cosim.hinf.certified_delay import CertifiedDelay, certified_delay
from cosim.hinf.closed_loop import close
from cosim.hinf.delay_margin import delay_margin
from cosim.hinf.demands import Demands, demands_of
from cosim.hinf.designing import design
from cosim.hinf.envelope import Envelope
from cosim.hinf.from_control import frequency_response, to_control
from cosim.hinf.greatest_delay import DELAY_LIMIT, GreatestDelay, with_delays
from cosim.hinf.lmi import CvxpyLmi, as_cvxpy
from cosim.hinf.named import NamedSystem, system_by_name
from cosim.hinf.norm import hinf_norm
from cosim.hinf.norm_proof import norm_proved
from cosim.hinf.roots import characteristic_roots, spectral_abscissa
from cosim.hinf.saved import design_from_json, design_to_json
from cosim.hinf.synthesis import Design
from cosim.hinf.uncertainty_price import nominal_gamma, without_uncertainty
from cosim.hinf.weights import weighted
from cosim.hinf.worst_case import WorstCase, worst_case
from cosim.hinf.yardsticks import Yardsticks, measured
from cosim.models.delay_system import Delay, DelaySystem

__all__ = [
    "DELAY_LIMIT",
    "Analysis",
    "AuvDesign",
    "Certificate",
    "CertifiedDelay",
    "CvxpyLmi",
    "Delay",
    "DelaySystem",
    "Demands",
    "Design",
    "Envelope",
    "GreatestDelay",
    "NamedSystem",
    "WorstCase",
    "Yardsticks",
    "analyse",
    "as_cvxpy",
    "auv_system",
    "certificate_bytes",
    "certificate_hash",
    "certified_delay",
    "characteristic_roots",
    "check_certificate",
    "close",
    "delay_margin",
    "demands_of",
    "design",
    "design_from_json",
    "design_to_json",
    "frequency_response",
    "greatest_delay",
    "hinf_norm",
    "measured",
    "nominal_gamma",
    "norm_proved",
    "read_certificate",
    "spectral_abscissa",
    "system_by_name",
    "to_control",
    "weighted",
    "with_delays",
    "without_uncertainty",
    "worst_case",
]
