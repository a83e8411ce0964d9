"""`python -m ergon` is the command `ergon`."""

from ergon.cli.start import main

if __name__ == "__main__":
    main()
