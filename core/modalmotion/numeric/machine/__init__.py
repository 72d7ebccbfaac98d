"""Machine code of kernels: compiled once, kept in files, mapped and called."""
