"""Reports on one scene: render time against error, for several configurations."""
