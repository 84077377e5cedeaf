"""Motion files and the path of a joint through them."""
