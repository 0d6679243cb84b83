"""Checks of a recording before any fit: each fault is reported, and repaired only where the report says so."""
