"""HTTP: heads, bodies, problems, limits, logs."""
