"""Sources of the kernels of large meshes, which numba compiles: see `numeric.machine`."""
