"""The names that programs use: the front door, and a second circle at the faces of packages.

Everything else that a face offers is for the other packages of this project.
"""

from __future__ import annotations

RING: dict[str, tuple[str, ...]] = {
    "cosim.hinf": (
        *("CertificateCheck", "DelayLTI", "DesignConstraints", "GreatestDelay", "MessageAges"),
        *("as_cvxpy", "auv_system", "certified_delay", "characteristic_roots", "delay_margin"),
        *("design_output_feedback", "greatest_delay", "hinf_norm", "lti", "message_ages"),
        *("spectral_abscissa", "system_by_name"),
    ),
    "cosim.hinf.delay_lti": (
        *("append", "close", "dead_time", "exp", "feedback", "parallel", "series"),
    ),
    "cosim.trace": (
        *("Diff", "Rows", "Series", "Signal", "Table", "Tolerances", "TopicInfo", "TraceWriter"),
        *("Verification", "content_hash", "describe", "diff", "export", "recover", "render"),
        "verify",
    ),
    "cosim.fmu": ("FmuDescription", "FmuSlave", "FmuState", "Port", "describe_fmu"),
    "cosim.vehicle": (
        *(
            "Flight",
            "FlightSettings",
            "Mission",
            "Vehicle",
            "find_trim",
            "fly",
            "linear_model",
            "load_vehicle",
        ),
        "named_vehicle",
    ),
    "cosim.recordings": (
        *("LinkFit", "fit_link", "outage_verdict", "read_recording", "statistics_of"),
        "write_recordings",
    ),
    "cosim.study": (
        *("Study", "StudyResult", "boundary", "builtin_studies", "load_study", "merge_studies"),
        *("read_table", "sensitivity", "summarise"),
    ),
    "cosim.replay": ("InjectionRequest", "Rerun", "SignalMapping", "rerun"),
    "cosim.scenario": (
        *("FmuCache", "Outcome", "as_text", "builtin_names", "check_step", "export_ssp"),
        *("import_ssp", "json_schema", "prepare", "template"),
    ),
    "cosim.network": (
        *("GilbertElliott", "Jitter", "LogFormat", "LossChain", "PacketLink", "Recording"),
    ),
    "cosim.master": ("Pace", "Snapshot"),
    "cosim.core": (
        *("ComponentError", "InputError", "LossError", "NotAchievableError", "Progress"),
    ),
}
"""Face -> the names of the second circle that it offers."""
