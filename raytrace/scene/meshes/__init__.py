"""Mesh files of all formats to arrays of triangles."""
