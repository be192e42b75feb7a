"""The passes of the wavefront, one a file: kernels over batches of rays."""
