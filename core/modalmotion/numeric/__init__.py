"""Numerics that are the same on any number of threads and hold at extreme sizes."""
