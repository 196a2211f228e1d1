"""What the service does, for Prometheus and whoever reads its format: links, losses, jobs, disk, memory.

Names follow Prometheus's practices: base units, `_total` for what only grows.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from typing import Any

from fastapi import APIRouter
from fastapi.responses import Response
from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4

from gcs.api.service import Service, Serving, Watched
from gcs.version import VERSION

router = APIRouter(tags=["state"])

# Counters of a link: its key in /api/links, and what it counts.
_OF_LINKS = {
    "bytes": ("received_bytes", "Bytes that came"),
    "bytes_sent": ("sent_bytes", "Bytes that were sent"),
    "frames": ("frames", "MAVLink frames that came"),
    "bad_crc": ("bad_checksums", "Frames whose checksum is wrong"),
    "raw_bytes": ("stray_bytes", "Bytes that belong to no frame"),
    "dropped": ("dropped_datagrams", "Datagrams for which the kernel had no room"),
    "refused": ("refused_bytes", "Bytes that peers sent beyond what one of them may send"),
    "send_errors": ("send_errors", "What could not be sent"),
    "reconnects": ("reconnects", "Times that the link was opened again"),
    "signed_bad": ("bad_signatures", "Frames with a wrong signature"),
}


class _Collector:
    """Everything at one moment, when it is asked for."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def collect(self) -> Iterator[Metric]:
        """Every family of figures."""
        yield from self._station()
        yield from self._links()
        yield from self._jobs()

    def _station(self) -> Iterator[Metric]:
        service = self._service
        built = GaugeMetricFamily("gcs_build_info", "Version of the ground station", labels=["version"])
        built.add_metric([VERSION], 1.0)
        yield built
        yield _gauge("gcs_uptime_seconds", "Since the start of the service", time.monotonic() - service.started)
        disk = shutil.disk_usage(service.settings.data)
        yield _gauge("gcs_disk_free_bytes", "Free space where recordings go", disk.free)
        yield _gauge("gcs_disk_size_bytes", "Size of the disk where recordings go", disk.total)
        yield _gauge(
            "gcs_flights_being_recorded", "Flights that are being recorded", len(service.recorder.live_flights())
        )
        yield _counter(
            "gcs_unrecorded_bytes", "Bytes that could not be recorded", service.recorder.state.unrecorded_bytes
        )
        yield _counter("gcs_live_dropped_bytes", "Bytes that the live side had no time for", service.live.dropped_bytes)
        parts: tuple[Watched, ...] = (service.recorder, service.catalogue, service.jobs, *service.others)
        troubled = [one for one in parts if one.problem]
        yield _gauge("gcs_problems", "Parts of the service that are in trouble; /api/health says which", len(troubled))

    def _links(self) -> Iterator[Metric]:
        connected = GaugeMetricFamily("gcs_link_connected", "Whether a link stands", labels=["link", "role"])
        counted = {
            key: CounterMetricFamily(f"gcs_link_{name}", words, labels=["link", "role"])
            for key, (name, words) in _OF_LINKS.items()
        }
        senders = ["link", "system", "component"]
        received = CounterMetricFamily("gcs_messages_received", "Messages of a sender on a link", labels=senders)
        lost = CounterMetricFamily("gcs_messages_lost", "Messages missing in a sender's sequence", labels=senders)
        links: list[dict[str, Any]] = self._service.recorder.link_status()
        for link in links:
            where = [str(link["url"]), str(link["role"])]
            connected.add_metric(where, float(link["connected"]))
            for key, family in counted.items():
                family.add_metric(where, float(link[key]))
            for sender, component in _senders(link):
                received.add_metric(sender, float(component["received"]))
                lost.add_metric(sender, float(component["lost"]))
        yield connected
        yield from counted.values()
        yield from (received, lost)

    def _jobs(self) -> Iterator[Metric]:
        counts, waits_since_ns = self._service.catalogue.job_states()
        jobs = GaugeMetricFamily("gcs_jobs", "Jobs in the catalogue by their state", labels=["state"])
        for state in ("queued", "running", "done", "failed", "skipped", "cancelled"):
            jobs.add_metric([state], float(counts.get(state, 0)))
        yield jobs
        age = 0.0 if waits_since_ns is None else max(time.time() - 1e-9 * waits_since_ns, 0.0)
        yield _gauge("gcs_job_queue_age_seconds", "How long the oldest job has waited, 0 where none waits", age)


def _senders(link: dict[str, Any]) -> Iterator[tuple[list[str], dict[str, Any]]]:
    """Each sender of a link; one that is heard from several peers counts once, with all of them."""
    summed: dict[tuple[str, str], dict[str, Any]] = {}
    for system in link["systems"]:
        for component in system["components"]:
            key = str(system["system"]), str(component["component"])
            before = summed.get(key, {"received": 0, "lost": 0})
            summed[key] = {name: before[name] + component[name] for name in before}
    for (system, component), found in summed.items():
        yield [str(link["url"]), system, component], found


def _gauge(name: str, words: str, value: float) -> Metric:
    return GaugeMetricFamily(name, words, value=float(value))


def _counter(name: str, words: str, value: float) -> Metric:
    return CounterMetricFamily(name, words, value=float(value))


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {}}, "description": "Prometheus's text format"}},
)
def metrics(service: Serving) -> Response:
    """Figures of the service for Prometheus: links, losses, jobs, disk, its own memory and processor time."""
    registry = CollectorRegistry()
    registry.register(_Collector(service))
    ProcessCollector(namespace="gcs", registry=registry)
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_PLAIN_0_0_4)
