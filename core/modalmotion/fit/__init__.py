"""Least-squares fit of modes to a sequence, (2) inverted, and superposition back, (2)."""
