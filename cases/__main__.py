"""`python -m cases` is `sdm`."""

from sdm_deflect.cases.cli.supervisor import main

if __name__ == "__main__":
    main()
