"""The command line, except that lines of a session have no limit."""

from ergon.cli.app import main
from ergon.repl.session import computing

if __name__ == "__main__":
    computing.LINE_STEPS = computing.FILES_STEPS = 1 << 60
    main()
