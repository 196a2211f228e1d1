"""Discrepancy on flights as the field gives them: candidates compared by the posterior with an estimated noise."""
