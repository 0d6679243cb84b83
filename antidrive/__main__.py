"""`python -m antidrive`, where the command itself is not on the path."""

import sys

from antidrive.cli import main

if __name__ == "__main__":
    sys.exit(main())
