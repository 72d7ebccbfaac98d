"""Sources of the kernels: a subset of Python that numba compiles. They run nowhere else."""
