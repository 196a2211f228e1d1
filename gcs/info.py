"""What a recording holds, for people and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gcs.clockinfo import clock_text, clocks
from gcs.conversion import check_file, import_file
from gcs.dialect import DEFAULT_DIALECT
from gcs.linkinfo import link_counts, radio_text, radios
from gcs.recording.reader import Recording
from gcs.signing import SignatureCounts
from gcs.utctext import utc_text


@contextmanager
def as_recordings(paths: list[Path], dialect: str = DEFAULT_DIALECT) -> Iterator[list[Path]]:
    """The same recordings as MCAP: other formats are imported to files that are gone afterwards."""
    with TemporaryDirectory(prefix="gcs-") as folder:
        converted = []
        for number, path in enumerate(paths):
            check_file(path)
            if path.suffix.lower() == ".mcap":
                converted.append(path)
                continue
            target = Path(folder) / str(number) / f"{path.stem}.mcap"
            target.parent.mkdir()
            import_file(path, target, dialect=dialect)
            converted.append(target)
        yield converted


def describe_recording(path: Path, key: bytes | None = None) -> dict[str, Any]:
    """Counts, rates, losses and clocks of an MCAP recording, ready for JSON. Raises RecordingError.

    key: what signatures are checked with.
    """
    recording = Recording(path)
    counts = recording.counts()
    damage = recording.damage
    duration_s = (recording.end_ns - recording.start_ns) / 1e9
    links = link_counts(recording, key)
    return {
        "file": str(path),
        "size_bytes": path.stat().st_size,
        "start": utc_text(recording.start_ns) if recording.start_ns else None,
        "end": utc_text(recording.end_ns) if recording.end_ns else None,
        "duration_s": duration_s,
        "messages": sum(counts.values()),
        "topics": [_topic(recording, topic, count) for topic, count in sorted(counts.items())],
        "components": _components(recording, counts),
        "links": [{"link": link, **counts.to_json()} for link, counts in links.items()],
        "radios": radios(recording),
        "raw_bytes": sum(counts.raw_bytes for counts in links.values()),
        "clock": clocks(recording),
        "damage": list(damage.notes),
        "truncated": damage.truncated,
    }


def _topic(recording: Recording, topic: str, count: int) -> dict[str, Any]:
    _, _, system, component, name = topic.split("/")
    times = [columns.log_time for columns in recording.columns(name, int(system), int(component))]
    span = max((float(at[-1] - at[0]) / 1e9 for at in times if at.size > 1), default=0.0)
    distinct = sum(at.size for at in times)
    return {"topic": topic, "count": count, "rate_hz": (distinct - 1) / span if span > 0 else None}


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
        "",
        f"{'topic':<44} {'count':>9} {'Hz':>9}",
    ]
    for topic in info["topics"]:
        rate = "" if topic["rate_hz"] is None else f"{topic['rate_hz']:.2f}"
        lines.append(f"{topic['topic']:<44} {topic['count']:>9} {rate:>9}")
    lines += ["", f"{'link, system, component':<44} {'lost':>9}"]
    for entry in info["components"]:
        sender = f"{entry['link']}, {entry['system']}, {entry['component']}"
        lines.append(f"{sender:<44} {entry['lost']:>9}")
    lines += ["", *(_link_text(entry) for entry in info["links"]), *map(radio_text, info["radios"])]
    lines += map(clock_text, info["clock"])
    lines += [f"damage: {note}" for note in info["damage"]]
    return "\n".join(lines)


def _link_text(entry: dict[str, Any]) -> str:
    line = f"{entry['link']}: {entry['raw_bytes']} bytes in no frame"
    counts = SignatureCounts.of(entry)
    return f"{line}; {counts.text()}" if counts.good or counts.bad or counts.unverified else line
