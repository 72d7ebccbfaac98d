"""The command line."""

from modalmotion.cli.main import main

__all__ = ["main"]
