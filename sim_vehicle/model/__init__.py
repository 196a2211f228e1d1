"""Model files and the grammar of their terms."""
