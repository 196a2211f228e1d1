"""Arithmetic that knows nothing of flight: filters, smoothing, least squares, Gaussians, threads."""
