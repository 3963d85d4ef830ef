"""The command line, with one module for each verb."""

from skfmap.commands.dispatch import main

__all__ = ["main"]
