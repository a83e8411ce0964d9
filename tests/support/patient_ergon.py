"""The command line, except that a line of a session may take as long as a busy machine needs."""

from ergon.cli.app import main
from ergon.repl.session import computing

if __name__ == "__main__":
    computing.LINE_SECONDS = computing.FILES_SECONDS = 1e3
    main()
