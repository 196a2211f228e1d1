"""Vehicle files: what they say, and as the flat arrays that compiled code takes."""
