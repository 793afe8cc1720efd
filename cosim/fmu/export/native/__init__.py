"""The native flavour: the equations as C, a shell in C99 around them, compiled."""
