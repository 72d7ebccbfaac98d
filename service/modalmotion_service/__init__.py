"""HTTP service around modalmotion."""
