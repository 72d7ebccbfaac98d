"""Frames that come one by one, in folders, archives and series."""
