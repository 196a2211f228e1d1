"""What a recording holds, for people and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gcs.flights.sender import AUTOPILOT_INVALID, GENERIC
from gcs.flights.streams import sender_of
from gcs.formats.conversion import check_file, import_file, is_bag
from gcs.inspection.clocks import clock_text, clocks
from gcs.inspection.links import link_counts, radio_text, radios
from gcs.inspection.pace import Pace, paces
from gcs.mavlink.dialect import DEFAULT_DIALECT, Dialect
from gcs.mavlink.signing import SignatureCounts
from gcs.recording.joined import all_parts
from gcs.recording.reader import Recording
from gcs.text.utctext import utc_text


@contextmanager
def as_recordings(
    paths: list[Path], dialect: str = DEFAULT_DIALECT, columns: Path | None = None
) -> Iterator[list[Path]]:
    """The same recordings as MCAP: other formats are imported to files that are gone afterwards.

    columns: file that says what columns of tables are.
    """
    if dialect != DEFAULT_DIALECT:
        # A recording holds its own definitions, but a dialect that is not there is a mistake beside one too.
        Dialect.load(dialect)
    with TemporaryDirectory(prefix="gcs-") as folder:
        converted = []
        for number, path in enumerate(paths):
            check_file(path)
            if path.suffix.lower() == ".mcap" and path.is_file() and not is_bag(path):
                converted.append(path)
                continue
            target = Path(folder) / str(number) / f"{path.resolve().name if path.is_dir() else path.stem}.mcap"
            target.parent.mkdir()
            import_file(path, target, dialect=dialect, columns=columns)
            converted.append(target)
        yield converted


def describe_recording(path: Path, key: bytes | None = None) -> dict[str, Any]:
    """Counts, rates, losses and clocks of an MCAP recording, ready for JSON. Raises RecordingError.

    path: its file, or the first of its parts, all of which are read then. key: what signatures are checked with.
    """
    files = all_parts(path)
    recording = Recording(files)
    counts = recording.counts()
    damage = recording.damage
    links = link_counts(recording, key)
    topic_paces, link_paces = paces(recording)
    start_ns = recording.start_ns
    return {
        "file": str(path),
        "files": [file.name for file in files],
        "size_bytes": sum(file.stat().st_size for file in files),
        "start": utc_text(recording.start_ns) if recording.start_ns else None,
        "end": utc_text(recording.end_ns) if recording.end_ns else None,
        "duration_s": recording.duration_s,
        "messages": sum(counts.values()),
        "topics": [
            _topic(recording, topic, count, topic_paces[topic], start_ns) for topic, count in sorted(counts.items())
        ],
        "senders": _senders(recording),
        "components": _components(recording, counts),
        "links": [
            {"link": link, **counts.to_json(), **_link_pace(link_paces[link], counts.bytes, start_ns)}
            for link, counts in links.items()
        ],
        "radios": radios(recording),
        "raw_bytes": sum(counts.raw_bytes for counts in links.values()),
        "clock": clocks(recording),
        "damage": list(damage.notes),
        "truncated": damage.truncated,
        "metadata": recording.metadata(),
        "attachments": [
            {"name": entry.name, "media_type": entry.media_type, "size_bytes": len(entry.data)}
            for entry in recording.attachments()
        ],
    }


def _topic(recording: Recording, topic: str, count: int, pace: Pace, start_ns: int) -> dict[str, Any]:
    """Rate and longest gap of one topic; what came over several links counts once."""
    distinct = count
    if count and recording.is_repeated(topic):
        _, _, system, component, name = topic.split("/")
        distinct = sum(len(part) for part in recording.iter_columns(name, int(system), int(component)))
    gap_s, gap_at_s = pace.gap(start_ns)
    return {
        "topic": topic,
        "count": count,
        "rate_hz": (distinct - 1) / pace.duration_s if pace.duration_s > 0 else None,
        "longest_gap_s": gap_s,
        "longest_gap_at_s": gap_at_s,
    }


def _link_pace(pace: Pace, size: int, start_ns: int) -> dict[str, Any]:
    gap_s, gap_at_s = pace.gap(start_ns)
    return {
        "messages": pace.count,
        "bytes_per_s": size / pace.duration_s if pace.duration_s > 0 else None,
        "duration_s": pace.duration_s,
        "longest_silence_s": gap_s,
        "longest_silence_at_s": gap_at_s,
    }


def _senders(recording: Recording) -> list[dict[str, object]]:
    """Every vehicle in the recording that says what it is."""
    systems = {columns.system for columns in recording.columns("HEARTBEAT")}
    found = [sender_of(recording, system) for system in sorted(systems)]
    return [one.to_json() for one in found if (one.kind, one.autopilot) != (GENERIC, AUTOPILOT_INVALID)]


def _components(recording: Recording, counts: dict[str, int]) -> list[dict[str, Any]]:
    """Losses per link and component by gaps in the sender's counter."""
    return [
        {
            "link": link,
            "system": system,
            "component": component,
            "messages": sum(
                count for topic, count in counts.items() if topic.startswith(f"/mavlink/{system}/{component}/")
            ),
            "lost": lost,
        }
        for (link, system, component), lost in sorted(recording.lost().items())
    ]


def info_text(info: dict[str, Any]) -> str:
    """The same as lines for a terminal."""
    lines = [
        f"{info['file']}: {info['size_bytes']} bytes, {info['messages']} messages",
        f"from {info['start']} to {info['end']}, {info['duration_s']:.3f} s",
        *(f"system {one['system']}: {one['type']}, {one['autopilot']}" for one in info["senders"]),
        "",
        f"{'topic':<44} {'count':>9} {'Hz':>9} {'longest gap, s':>15}",
    ]
    for topic in info["topics"]:
        rate = "" if topic["rate_hz"] is None else f"{topic['rate_hz']:.2f}"
        gap = _gap_text(topic["longest_gap_s"], topic["longest_gap_at_s"])
        lines.append(f"{topic['topic']:<44} {topic['count']:>9} {rate:>9} {gap:>15}".rstrip())
    lines += ["", f"{'link, system, component':<44} {'lost':>9}"]
    for entry in info["components"]:
        sender = f"{entry['link']}, {entry['system']}, {entry['component']}"
        lines.append(f"{sender:<44} {entry['lost']:>9}")
    lines += ["", *(_link_text(entry) for entry in info["links"]), *map(radio_text, info["radios"])]
    lines += map(clock_text, info["clock"])
    lines += _note_lines(info)
    lines += [f"damage: {note}" for note in info["damage"]]
    if info["truncated"]:
        lines.append(
            f"incomplete: the file ends {info['duration_s']:.1f} s after its first message without a recording's end:"
            " still being written, or cut off; copy the whole file again, or make what is there whole by `gcs recover`"
        )
    return "\n".join(lines)


def _gap_text(gap_s: float | None, at_s: float | None) -> str:
    return "" if gap_s is None or at_s is None else f"{gap_s:.2f} at {at_s:.1f}"


def _note_lines(info: dict[str, Any]) -> list[str]:
    """What was put into the recording besides messages."""
    lines = [
        f"attached: {entry['name']}, {entry['size_bytes']} bytes ({entry['media_type']})"
        for entry in info["attachments"]
    ]
    for name, values in info["metadata"].items():
        lines += [f"{name}: {key} = {value}" for key, value in values.items()]
    return lines


def _link_text(entry: dict[str, Any]) -> str:
    line = f"{entry['link']}: {entry['messages']} messages, {entry['bytes']} bytes"
    line += "" if entry["bytes_per_s"] is None else f" ({entry['bytes_per_s']:.0f}/s)"
    line += f", {entry['raw_bytes']} bytes in no frame"
    line += "" if entry["bad_crc"] is None else f", {entry['bad_crc']} checksum failures"
    silence = _gap_text(entry["longest_silence_s"], entry["longest_silence_at_s"])
    line += f", longest silence {silence} s" if silence else ""
    counts = SignatureCounts.of(entry)
    return f"{line}; {counts.text()}" if counts.good or counts.bad or counts.unverified else line
