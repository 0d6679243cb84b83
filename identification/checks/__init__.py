"""What may be wrong with a recording before any model is asked: found, said, and repaired only where that is said."""
