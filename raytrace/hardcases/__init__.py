"""Hard rays for ray tracers, and exact arithmetic that checks the answers; independent of the renderer."""
