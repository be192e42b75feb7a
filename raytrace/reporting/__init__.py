"""How good and how fast a picture is: error against a reference, and reports."""
