"""A station asked from Python, over its REST interface: plainly (`Station`), or from asyncio (`AsyncStation`)."""

from gcs.client.async_station import AsyncStation
from gcs.client.station import Station
from gcs.errors import StationError

__all__ = ["AsyncStation", "Station", "StationError"]
