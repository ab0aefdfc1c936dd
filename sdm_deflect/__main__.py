"""`python -m sdm_deflect` is the command `sdm`."""

from sdm_deflect.cases.cli import main

main()
