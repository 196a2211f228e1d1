"""Figures of the service, read by Prometheus's own parser."""

from __future__ import annotations

from pathlib import Path

import pytest
from api_bench import START, TOKEN, Bench
from prometheus_client.parser import text_string_to_metric_families
from serving import serving
from traffic import wait_until

from gcs.version import VERSION


def figures(text: str) -> dict[str, float]:
    """`name{label=value,…}` -> value."""
    return {
        f"{sample.name}{sorted(sample.labels.items())}" if sample.labels else sample.name: sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_figures_are_those_of_the_interface(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    flight = bench.record(7, 3, START)
    with serving(bench.app) as client:
        job = client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify"}).json()
        wait_until(lambda: client.get(f"/api/jobs/{job['id']}").json()["state"] == "done")
        answer = client.get("/metrics")
        assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
        found = figures(answer.text)
        health, (link,) = client.get("/api/health").json(), client.get("/api/links").json()
    where = f"[('link', '{link['url']}'), ('role', 'vehicle')]"
    assert found[f"gcs_build_info[('version', '{VERSION}')]"] == 1.0
    assert found["gcs_disk_size_bytes"] == health["disk_total_bytes"]
    assert found[f"gcs_link_connected{where}"] == 1.0
    assert found[f"gcs_link_frames_total{where}"] == link["frames"]
    assert found["gcs_jobs[('state', 'done')]"] == 1.0
    assert found["gcs_jobs[('state', 'failed')]"] == 0.0
    assert found["gcs_job_queue_age_seconds"] == 0.0
    assert found["gcs_problems"] == 0.0
    assert found["gcs_process_resident_memory_bytes"] > 1e7


def test_losses_are_counted_by_sender(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    status = {"url": "udpin:x", "role": "vehicle", "connected": True}
    counters = dict.fromkeys(
        ("bytes", "bytes_sent", "frames", "bad_crc", "raw_bytes", "dropped", "refused", "send_errors", "reconnects"), 2
    )
    peers = [
        {"system": 1, "components": [{"component": 1, "received": 90, "lost": 10}]},
        {"system": 1, "components": [{"component": 1, "received": 5, "lost": 0}]},
    ]
    bench.station.link_status = lambda: [{**status, **counters, "signed_bad": 0, "systems": peers}]  # type: ignore[method-assign]
    with serving(bench.app) as client:
        found = figures(client.get("/metrics").text)
    sender = "[('component', '1'), ('link', 'udpin:x'), ('system', '1')]"
    assert (found[f"gcs_messages_received_total{sender}"], found[f"gcs_messages_lost_total{sender}"]) == (95.0, 10.0)
    assert found["gcs_link_send_errors_total[('link', 'udpin:x'), ('role', 'vehicle')]"] == 2.0


@pytest.mark.parametrize("token", ["", "wrong"])
def test_figures_need_the_token(tmp_path: Path, token: str) -> None:
    bench = Bench(tmp_path, token=TOKEN)
    with serving(bench.app) as client:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        assert client.get("/metrics", headers=headers).status_code == 401
        assert client.get("/metrics", headers={"Authorization": f"Bearer {TOKEN}"}).status_code == 200
