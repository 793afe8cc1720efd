"""Certified delay-dependent control, packed as FMUs, flown over links with delay and loss."""
