"""The ray engine: SIMD lanes, boxes, triangles, the tree and its traversal."""
