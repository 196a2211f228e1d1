"""Shapes of requests and answers: what OpenAPI describes is what the handlers give."""
