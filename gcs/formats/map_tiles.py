"""Pictures of a map from a file of one's own: MBTiles, a SQLite database of tiles.

Source: MBTiles specification 1.3 (github.com/mapbox/mbtiles-spec): tables `metadata` (name, value) and `tiles`
(zoom_level, tile_column, tile_row, tile_data), rows counted from the south.
"""

from __future__ import annotations

import sqlite3
import threading
from pathlib import Path

from gcs.errors import SettingsError

#: Format of the file -> media type. Tiles of vectors (pbf) would have to be drawn.
KINDS = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_DEEPEST = 24


class MapTiles:
    """A map's tiles. path: the file. Raises SettingsError, in one line, where it is none that can be shown."""

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        try:
            self._database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, check_same_thread=False)
            stated = dict(self._database.execute("SELECT name, value FROM metadata"))
            zooms = self._database.execute(
                "SELECT min(zoom_level), max(zoom_level) FROM tiles WHERE typeof(zoom_level) = 'integer'"
            ).fetchone()
        except sqlite3.Error as error:
            raise SettingsError(f"--map {path}: {error}; give an MBTiles file of pictures") from error
        kind = str(stated.get("format", "png")).lower()
        if kind not in KINDS:
            raise SettingsError(
                f"--map {path}: its tiles are {kind}; give a file of pictures (png, jpg or webp), as QGIS writes"
            )
        if zooms[0] is None:
            raise SettingsError(f"--map {path}: it holds no tiles")
        self.kind = KINDS[kind]
        self.least_zoom, self.most_zoom = (min(max(int(zoom), 0), _DEEPEST) for zoom in zooms)
        self.attribution = str(stated.get("attribution", ""))

    def tile(self, zoom: int, column: int, row: int) -> bytes | None:
        """The picture of a tile, rows counted from the north as on the web; None where the file has none."""
        if not 0 <= zoom <= _DEEPEST or not 0 <= column < 1 << zoom or not 0 <= row < 1 << zoom:
            return None
        query = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        with self._lock:
            try:
                found = self._database.execute(query, (zoom, column, (1 << zoom) - 1 - row)).fetchone()
            except sqlite3.Error:
                return None
        return found[0] if found and isinstance(found[0], bytes) else None

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()
