"""The command line, except that a line of a session may take as long as a busy machine needs."""

from ergon.cli.app import main
from ergon.repl.session import computing

if __name__ == "__main__":
    computing.LINE = computing.FILES = 1e3
    main()
