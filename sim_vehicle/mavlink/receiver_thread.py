"""The thread that hears what the ground station sends, so that answers do not wait for a tick."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from sim_vehicle.errors import SimVehicleError
from sim_vehicle.mavlink.outputs import Link
from sim_vehicle.mavlink.vehicle_node import Craft

_POLL_S = 0.1  # how soon the thread sees that it is to end
_LONGEST_END_S = 1.0  # it may stand behind a link that takes nothing more


class Uplink:
    """Hands what a link hears to every vehicle behind it, each of which takes what is for it."""

    def __init__(self, link: Link, crafts: Sequence[Craft]) -> None:
        self._link = link
        self._crafts = crafts
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop hearing; the link itself stays open."""
        self._stopping.set()
        self._thread.join(_LONGEST_END_S)

    def _serve(self) -> None:
        while not self._stopping.is_set():
            data = self._link.receive(_POLL_S)
            for craft in self._crafts if data else ():
                try:
                    craft.hear(data)
                except SimVehicleError:
                    return  # the link failed under an answer; the next tick's frames report it
