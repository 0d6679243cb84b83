"""One reader for each kind of file, from its bytes to a table, without checks."""
