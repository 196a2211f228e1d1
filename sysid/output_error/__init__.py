"""Output error: maximum likelihood of a free-running simulation."""
