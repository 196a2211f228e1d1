"""Loading what is compiled before the first bytes come."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.clock.fit import fit_clock
from gcs.links.datagrams import Batch
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.frameparts import frame_times
from gcs.mavlink.framing import Framer
from gcs.recording.writer import McapWriter
from gcs.station.linkstats import LinkStatistics
from gcs.station.segmentation import FlightSegmenter


def warm_up(dialect: Dialect) -> None:
    """Take one frame through everything compiled, which loads it.

    The first bytes of a link would else wait for that, while the silence behind them counts as the flight's end.
    """
    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = common.MAVLink_heartbeat_message(common.MAV_TYPE_FIXED_WING, common.MAV_AUTOPILOT_GENERIC, 0, 0, 0, 3)
    batch = Batch.of([(bytes(beat.pack(sender)), 1)])
    buffer, frames = Framer(dialect).feed(batch.data)
    received = frame_times(frames, batch.ends, batch.received_ns, 0)
    LinkStatistics(dialect).add(frames, received)
    seconds = np.arange(40) * 1_000_000_000
    fit_clock(seconds, seconds)
    segmenter = FlightSegmenter(dialect, 1, 1)
    segmenter.system = 1
    segmenter.clock_reset("", frames, received)
    with tempfile.TemporaryDirectory(prefix="gcs-") as folder, McapWriter(Path(folder) / "x.mcap", dialect) as writer:
        writer.write("", buffer, frames, received)
