"""`python -m ropefit` is the same as `ropefit`."""

from ropefit.cli import main

main()
