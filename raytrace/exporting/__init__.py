"""Exports scenes to the formats of other renderers."""
