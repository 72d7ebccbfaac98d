"""VTK and VTKHDF files."""
