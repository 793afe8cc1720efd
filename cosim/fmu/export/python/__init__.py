"""The pythonfmu flavour: an FMI 2.0 slave around a behaviour, without any physics."""
