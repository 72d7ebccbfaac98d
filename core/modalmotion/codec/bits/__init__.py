"""Bits: integers, matrices and corrections by entropy coding."""
