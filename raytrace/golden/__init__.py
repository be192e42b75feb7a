"""Golden images for pytest: a fixture that compares an image with an approved one."""
