"""The passes of the wavefront, one per file: kernels over batches of rays."""
