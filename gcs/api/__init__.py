"""The REST interface."""

from gcs.api.app import create_app

__all__ = ["create_app"]
