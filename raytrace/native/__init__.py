"""Machine code of kernels: compiled once, kept, loaded by later processes without a compiler."""
