"""An observer of late measurements, alone or with the feedback of its estimate."""
