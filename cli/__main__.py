"""`python -m ergon.cli` is the command `ergon`."""

from .start import main

if __name__ == "__main__":
    main()
