"""Golden pictures for pytest: a fixture that compares a picture with the one that was approved."""
