"""`python -m cosim`: the command without its script."""

from cosim.entry import main

main()
