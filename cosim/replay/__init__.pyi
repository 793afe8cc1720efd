from .embedded_certificate import (
    EmbeddedCertificate as EmbeddedCertificate,
    certificate_in as certificate_in,
)
from .injection import (
    InjectionResult as InjectionResult,
    inject as inject,
)
from .injection_request import InjectionRequest as InjectionRequest
from .mapping import SignalMapping as SignalMapping
from .scenario_of_trace import scenario_of as scenario_of
from .trace_rerun import (
    Rerun as Rerun,
    rerun as rerun,
)
