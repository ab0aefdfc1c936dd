"""`python -m cases` is `sdm`."""

from cases.cli import main

if __name__ == "__main__":
    main()
