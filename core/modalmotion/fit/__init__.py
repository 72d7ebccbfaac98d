"""Least-squares fit of modes to a sequence, and superposition back (eq. 2)."""
