"""Machine code of the kernels: where it is kept, how it is loaded and called."""
