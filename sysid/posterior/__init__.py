"""Maximum a posteriori output error with an estimated noise spectrum: flights as the field gives them."""
