"""The native flavour: equations recorded as C, a C99 shell around them, compiled."""
