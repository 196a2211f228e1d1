"""Text for people and programs: JSON, times, sizes, progress."""
