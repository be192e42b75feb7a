"""Image files, colour and error measures; knows nothing of rendering."""
