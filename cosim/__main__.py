"""`python -m cosim`: the command without its script."""

from cosim.cli import main

main()
