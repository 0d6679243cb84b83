"""Checks of a recording before any fit: each fault is reported, and each repair too."""
