"""Image files, colour conversion and error measures; independent of the renderer."""
