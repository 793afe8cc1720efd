"""resources/ of an FMU: what travels with it beside code and documentation."""

from __future__ import annotations

from .spec import ComponentSpec

CERTIFICATE = "resources/certificate.json"
"""Where a controller carries the proof of its gain."""


def resource_files(spec: ComponentSpec) -> dict[str, bytes]:
    """Archive path -> content: the certificate, where the component has one."""
    return {} if spec.certificate is None else {CERTIFICATE: spec.certificate}
