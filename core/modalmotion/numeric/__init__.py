"""Numerics that hold at extreme sizes."""
