"""Render a scene: options, work items, threads, checkpoints, clusters."""
