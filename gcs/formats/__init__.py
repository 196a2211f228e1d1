"""Recordings in other formats, read and written."""
