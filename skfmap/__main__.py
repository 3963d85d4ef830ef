"""Entry point of ``python -m skfmap``: a command, or the demonstration."""

import sys

from skfmap.commands import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
