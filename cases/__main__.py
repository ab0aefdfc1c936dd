"""`python -m cases` is `sdm`."""

from sdm_deflect.cases.cli import main

if __name__ == "__main__":
    main()
