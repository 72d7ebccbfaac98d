"""Orthonormal modes that a stream is written in."""
