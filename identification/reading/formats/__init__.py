"""One reader for each kind of file, from its bytes to a table; nothing is judged yet."""
