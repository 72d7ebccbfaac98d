"""Natural coordinates (s, theta), one file for each kind of surface."""
