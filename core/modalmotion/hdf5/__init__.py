"""HDF5: sealed images of results, their contents, and the gate before files from outside."""
