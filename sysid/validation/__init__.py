"""Model against other flights: residuals and their statistics."""
