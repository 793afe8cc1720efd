"""The pythonfmu flavour: FMI 2.0 plumbing around a behaviour, apart from any physics."""
