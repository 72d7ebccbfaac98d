"""Alignment: the reference, the mean shape, rotations, displacements."""
