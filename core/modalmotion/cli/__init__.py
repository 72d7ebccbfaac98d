"""The command line."""

from modalmotion.cli.commands import main

__all__ = ["main"]
