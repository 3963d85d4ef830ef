"""What ``python -m skfmap`` runs: a verb, or the demonstration."""

import sys

from skfmap.commands import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
