"""Rays that break ray tracers, and exact arithmetic that judges them; knows nothing of rendering."""
