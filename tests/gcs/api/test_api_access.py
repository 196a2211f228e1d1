"""Every operation of the interface times every role, tokens, links to one flight, wrong tokens, and the log of it."""

from __future__ import annotations

import json
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from api_bench import TOKEN, Bench, problem
from serving import serving

from gcs.access.audit import Audit, _File
from gcs.access.failures import MOST, Failures
from gcs.access.roles import Role, least_role
from gcs.access.shares import Shares
from gcs.access.token_file import TokenFile
from gcs.cli import main
from gcs.errors import SettingsError

pytestmark = pytest.mark.whole_flight

ROLES = ("viewer", "operator", "admin")
# What is not: reading for viewers, anything else for operators. Written out once more on purpose.
OPEN = {"GET /api/health", "GET /api/ready", "POST /api/login"}
VIEWERS_TOO = {"POST /api/logout", "POST /api/vehicles/check", "POST /api/vehicles/inertia"}
ADMINS_ONLY = {
    "GET /api/tokens",
    "GET /api/audit",
    "POST /api/vehicles",
    "PUT /api/vehicles/{vehicle_id}",
    "DELETE /api/vehicles/{vehicle_id}",
    "POST /api/vehicles/{vehicle_id}/restore",
}


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    return make_bench(token=TOKEN, host="0.0.0.0")


@pytest.fixture
def guarded(bench: Bench) -> Iterator[httpx.Client]:
    with serving(bench.app) as client:
        yield client


def by(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def status_of(client: httpx.Client, method: str, url: str, headers: dict[str, str]) -> int:
    with client.stream(method, url, headers=headers) as answer:  # events never end
        return answer.status_code


def test_every_operation_answers_the_roles_that_it_is_for(bench: Bench, guarded: httpx.Client) -> None:
    file = TokenFile(bench.settings.tokens)
    tokens = {role: file.add(f"the {role}".replace(" ", "-"), role) for role in ROLES}
    schema = guarded.get("/openapi.json").json()
    seen = set()
    for path, methods in schema["paths"].items():
        for method in map(str.upper, methods):
            name = f"{method} {path}"
            seen.add(name)
            url = path
            for part in ("flight_id", "job_id", "model_id", "vehicle_id", "zoom", "column", "row"):
                url = url.replace(f"{{{part}}}", "1")
            least = 0 if name in VIEWERS_TOO or method == "GET" else 1
            least = 2 if name in ADMINS_ONLY else least
            found = [status_of(guarded, method, url, by(tokens[role])) for role in ROLES]
            nobody = status_of(guarded, method, url, {})
            assert all(one < 500 or one == 503 for one in found), (name, found)
            if name in OPEN:
                assert not {nobody, *found} & {401, 403} or name == "POST /api/login", name
                continue
            assert nobody == 401, name
            assert [one == 403 for one in found] == [place < least for place in range(3)], (name, found)
    assert seen >= OPEN | VIEWERS_TOO | ADMINS_ONLY


def test_a_token_is_kept_as_a_hash_revoked_at_once_and_ends_by_itself(tmp_path: Path) -> None:
    now = [1000.0]
    file = TokenFile(tmp_path / "tokens.json", lambda: now[0])
    text = file.add("anna", "operator", 2.0)
    assert text not in (tmp_path / "tokens.json").read_text()
    assert stat.S_IMODE((tmp_path / "tokens.json").stat().st_mode) == 0o600
    # Another process, as a service that runs, sees it and its end.
    service = TokenFile(tmp_path / "tokens.json", lambda: now[0])
    found = service.identify(text)
    assert found is not None
    assert (found.name, found.role) == ("anna", Role.OPERATOR)
    assert service.identify(text + "x") is None
    now[0] += 2.0 * 86400.0
    assert service.identify(text) is None
    other = file.add("bert", "viewer")
    assert service.identify(other) is not None
    file.revoke("bert")
    assert service.identify(other) is None
    for wrong in (lambda: file.add("anna", "viewer"), lambda: file.add("", "viewer"), lambda: file.add("c", "king"),
                  lambda: file.revoke("nobody"), lambda: file.add("c", "viewer", 0.0)):  # fmt: skip
        with pytest.raises(SettingsError):
            wrong()
    (tmp_path / "tokens.json").write_text("{}")
    with pytest.raises(SettingsError, match="it is no file of gcs token"):
        service.tokens()


def test_the_command_makes_lists_and_revokes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = ["--data", str(tmp_path)]
    assert main(["token", "add", "anna", "--role", "operator", "--days", "7", *data]) == 0
    text = capsys.readouterr().out.strip()
    assert TokenFile(tmp_path / "tokens.json").identify(text) is not None
    assert main(["token", "list", "--json", *data]) == 0
    (listed,) = json.loads(capsys.readouterr().out)
    assert (listed["name"], listed["role"]) == ("anna", "operator")
    assert set(listed) == {"name", "role", "created", "expires"}
    assert main(["token", "list", *data]) == 0
    assert capsys.readouterr().out.startswith("anna  operator  until ")
    assert main(["token", "revoke", "anna", *data]) == 0
    assert main(["token", "revoke", "anna", *data]) == 2
    assert "there is no token anna" in capsys.readouterr().err


@pytest.mark.whole_flight
def test_a_link_shows_its_flight_and_nothing_else(bench: Bench, guarded: httpx.Client) -> None:
    flights = [bench.record(1, 3, 10**18), bench.record(2, 3, 10**18 + 10**11)]
    made = guarded.post(f"/api/flights/{flights[0]}/share", json={"days": 1}, headers=by(TOKEN)).json()
    token = made["path"].removeprefix("/#/shared/")
    with httpx.Client(base_url=guarded.base_url, timeout=guarded.timeout) as visitor:
        me = visitor.post("/api/login", json={"token": token}).json()
        assert (me["role"], me["flight"]) == ("viewer", flights[0])
        assert visitor.get(f"/api/flights/{flights[0]}").status_code == 200
        assert visitor.get(f"/api/flights/{flights[0]}/recording").status_code == 200
        problem(visitor.get(f"/api/flights/{flights[1]}"), 403)
        problem(visitor.get("/api/flights"), 403)
        problem(visitor.get("/api/live"), 403)
        assert "alone" in problem(visitor.delete(f"/api/flights/{flights[0]}"), 403)
        problem(visitor.post(f"/api/flights/{flights[0]}/share", json={}), 403)
        assert visitor.get("/api/me").json()["flight"] == flights[0]


@pytest.mark.whole_flight
def test_a_link_shows_nothing_of_who_works_with_the_flight_and_of_other_flights(
    bench: Bench, guarded: httpx.Client
) -> None:
    other, flight = (bench.record(1, 3, 10**18 + number * 10**11) for number in range(2))
    asked = {"kind": "identify", "validate": [other]}
    job = guarded.post(f"/api/flights/{flight}/jobs", json=asked, headers=by(TOKEN))
    assert job.status_code in (201, 202), job.text
    link = guarded.post(f"/api/flights/{flight}/share", json={}, headers=by(TOKEN)).json()["path"].rpartition("/")[2]
    whole, thin = (guarded.get(f"/api/flights/{flight}", headers=by(token)) for token in (TOKEN, link))
    assert (whole.status_code, thin.status_code) == (200, 200)
    assert [one["id"] for one in whole.json()["jobs"]] == [job.json()["id"]]
    for secret in (other, job.json()["id"], "127.0.0.1"):
        assert secret not in thin.text, secret
    assert (thin.json()["id"], thin.json()["signals"]) == (flight, whole.json()["signals"])


def test_a_link_is_listed_and_revoked_by_its_maker_and_administrators(bench: Bench, guarded: httpx.Client) -> None:
    file = TokenFile(bench.settings.tokens)
    anna, bert = (by(file.add(name, "operator")) for name in ("anna", "bert"))
    flight = bench.record(1, 3, 10**18)
    url = f"/api/flights/{flight}"
    first, second = (guarded.post(f"{url}/share", json={}, headers=anna).json() for _ in range(2))
    links = [by(one["path"].rpartition("/")[2]) for one in (first, second)]
    assert [guarded.get(url, headers=link).status_code for link in links] == [200, 200]
    listed = guarded.get("/api/shares", headers=anna).json()
    assert [(one["id"], one["maker"], one["flight"]) for one in listed] == [
        (one["id"], "anna", flight) for one in (first, second)
    ]
    assert set(listed[0]) == {"id", "maker", "flight", "made", "expires"}
    assert guarded.get("/api/shares", headers=by(TOKEN)).json() == listed
    assert guarded.get("/api/shares", headers=bert).json() == []
    problem(guarded.get("/api/shares", headers=links[0]), 403)
    problem(guarded.delete(f"/api/shares/{first['id']}", headers=bert), 404)
    problem(guarded.delete(f"/api/shares/{first['id']}", headers=links[0]), 403)
    assert guarded.delete(f"/api/shares/{first['id']}", headers=anna).status_code == 204
    assert "revoked" in problem(guarded.get(url, headers=links[0]), 401)
    assert guarded.get(url, headers=links[1]).status_code == 200
    assert guarded.delete(f"/api/shares/{second['id']}", headers=by(TOKEN)).status_code == 204
    problem(guarded.get(url, headers=links[1]), 401)
    assert guarded.get("/api/shares", headers=by(TOKEN)).json() == []
    # As the version before made them, signed and in no list.
    assert "kept no list" in problem(guarded.get(url, headers=by("share.MjAyNg.1800000000.c2ln")), 401)


def test_a_link_ends_with_what_its_maker_may_share(bench: Bench, guarded: httpx.Client) -> None:
    file = TokenFile(bench.settings.tokens)
    flight = bench.record(1, 3, 10**18)

    def link_of(token: str) -> dict[str, str]:
        made = guarded.post(f"/api/flights/{flight}/share", json={}, headers=by(token)).json()
        return by(made["path"].rpartition("/")[2])

    def seen(link: dict[str, str]) -> int:
        return guarded.get(f"/api/flights/{flight}", headers=link).status_code

    link, station = link_of(file.add("anna", "operator")), link_of(TOKEN)
    assert (seen(link), seen(station)) == (200, 200)
    kept = bench.settings.tokens.read_text()
    bench.settings.tokens.write_text(kept.replace('"operator"', '"viewer"'))
    assert seen(link) == 401
    bench.settings.tokens.write_text(kept.replace('"operator"', '"admin"'))
    assert seen(link) == 200
    file.revoke("anna")
    assert seen(link) == 401
    file.add("anna", "operator")  # another token of the same name has made none
    assert (seen(link), seen(station)) == (401, 200)
    problem(guarded.get("/api/shares", headers=by("x" * 20)), 401)
    assert [one["maker"] for one in guarded.get("/api/shares", headers=by(TOKEN)).json()] == ["GCS_TOKEN"]
    with pytest.raises(SettingsError, match="GCS_TOKEN"):
        file.add("GCS_TOKEN", "operator")


def test_links_are_listed_and_revoked_by_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shares = Shares(tmp_path / "shares.json")
    token, made = shares.make("20260101T000000.000Z-1", 3.0, "anna")
    data = ("--data", str(tmp_path))
    assert main(["token", "links", *data]) == 0
    assert capsys.readouterr().out.startswith(f"{made.id}  20260101T000000.000Z-1  by anna  until ")
    assert main(["token", "links", "--json", *data]) == 0
    assert json.loads(capsys.readouterr().out) == [made.shown()]
    assert main(["token", "revoke-link", made.id, *data]) == 0
    assert shares.find(token) is None
    assert main(["token", "revoke-link", made.id, *data]) == 2
    assert f"there is no link {made.id}" in capsys.readouterr().err


def test_what_came_of_a_flight_names_no_other_flight_to_a_link(bench: Bench, guarded: httpx.Client) -> None:
    other, flight = (bench.record(1, 3, 10**18 + number * 10**11) for number in range(2))
    url = f"/api/flights/{flight}"
    catalogue, link = bench.catalogue, guarded.post(f"{url}/share", json={}, headers=by(TOKEN)).json()
    visitor = by(link["path"].rpartition("/")[2])
    for kind, name in (("identify", "identification"), ("discrepancy", "discrepancy"), ("design", "design")):
        job = catalogue.add_job(flight, kind, {}, owner="10.1.2.3")
        result = {
            "schema": f"{name}/1", "model": {"coefficients": {}}, "segments": [{"flight": f"{flight}.mcap"}],
            "validation": {"flights": [f"{other}.mcap"]}, "warnings": [f"{other}.mcap is a flight that was fitted"],
        }  # fmt: skip
        catalogue.finish_job(job, result)
        whole, thin = (guarded.get(f"{url}/{name}", headers=one) for one in (by(TOKEN), visitor))
        assert (whole.status_code, whole.json()) == (200, result)
        assert thin.json()["segments"] == [{"flight": f"{flight}.mcap"}]
        assert thin.json()["validation"] == {"flights": ["other-1.mcap"]}
        assert thin.json()["warnings"] == ["other-1.mcap is a flight that was fitted"]
        for secret in (other, "10.1.2.3"):
            assert secret not in thin.text


def test_a_link_ends_and_a_forged_one_is_none(tmp_path: Path) -> None:
    now = [1000.0]
    shares = Shares(tmp_path / "shares.json", lambda: now[0])
    token, made = shares.make("20260101T000000Z-1", 3.0, "anna")
    assert made.expires == 1000.0 + 3.0 * 86400.0
    assert shares.find(token) == made
    for forged in (token[:-1], "share.", "share.a.b", "share.a.b.é", "x"):
        assert shares.find(forged) is None, forged
    assert stat.S_IMODE((tmp_path / "shares.json").stat().st_mode) == 0o600
    assert token not in (tmp_path / "shares.json").read_text()
    # Another process that has the same file, and another station.
    assert Shares(tmp_path / "shares.json", lambda: now[0]).find(token) == made
    assert Shares(tmp_path / "other.json", lambda: now[0]).find(token) is None
    now[0] = made.expires
    assert shares.find(token) is None
    with pytest.raises(SettingsError):
        shares.make("x", 1e6, "anna")
    for _ in range(200):
        shares.make("x", 1.0, "anna")
    with pytest.raises(SettingsError, match="revoke some"):
        shares.make("x", 1.0, "anna")
    shares.make("x", 1.0, "bert")


def test_logging_in_keeps_the_token_where_no_script_reads_it(guarded: httpx.Client) -> None:
    assert problem(guarded.post("/api/login", json={"token": "wrong"}), 401)
    answer = guarded.post("/api/login", json={"token": TOKEN})
    assert answer.json() == {"name": "GCS_TOKEN", "role": "admin", "flight": ""}
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert guarded.get("/api/flights").status_code == 200
    # The cookie of this station sent along by a page of another site is none.
    problem(guarded.get("/api/flights", headers={"Origin": "http://evil.example"}), 403)
    # Cookies of other applications on this host, which are nobody's to read, take nothing away.
    other = {"Cookie": f'theme={{"a": 1}}; x@y=1; gcs_token={TOKEN}'}
    assert httpx.get(f"{guarded.base_url}/api/flights", headers=other, timeout=guarded.timeout).status_code == 200
    assert guarded.post("/api/logout").status_code == 204
    problem(guarded.get("/api/flights"), 401)


def test_on_this_computer_no_token_is_asked_for_and_none_is_kept(make_bench: Callable[..., Bench]) -> None:
    with serving(make_bench().app) as client:
        answer = client.post("/api/login", json={"token": "\u2603 \x01;"})
    assert answer.status_code == 200, answer.text
    assert answer.json()["role"] == "admin"
    assert "set-cookie" not in answer.headers


def test_a_station_that_others_reach_stays_closed_when_its_last_token_is_revoked(
    make_bench: Callable[..., Bench],
) -> None:
    bench = make_bench(host="0.0.0.0")
    file = TokenFile(bench.settings.tokens)
    anna = file.add("anna", "admin")
    with serving(bench.app) as client:
        assert client.get("/api/flights", headers=by(anna)).status_code == 200
        file.revoke("anna")
        problem(client.get("/api/flights", headers=by(anna)), 401)
        problem(client.get("/api/flights"), 401)


def test_who_takes_back_the_last_token_opens_the_station_to_nobody(
    make_bench: Callable[..., Bench], tmp_path: Path
) -> None:
    file = TokenFile(tmp_path / "tokens.json")
    boss = file.add("boss", "admin")
    bench = make_bench(host="127.0.0.1")
    with serving(bench.app) as client:
        assert client.get("/api/me", headers=by(boss)).json()["name"] == "boss"
        file.revoke("boss")
        problem(client.get("/api/me", headers=by(boss)), 401)
        problem(client.get("/api/me"), 401)
        assert TokenFile(tmp_path / "tokens.json").ever()  # as a service that starts now finds it
        (tmp_path / "tokens.json").unlink()
        problem(client.get("/api/me"), 401)
    # Only who deletes the file and starts the service again goes back to a station without tokens.
    assert not TokenFile(tmp_path / "tokens.json").ever()


def test_looking_at_a_link_ends_no_session(bench: Bench, guarded: httpx.Client) -> None:
    flight = bench.record(1, 3, 10**18)
    guarded.post("/api/login", json={"token": TOKEN})
    token = guarded.post(f"/api/flights/{flight}/share", json={}).json()["path"].removeprefix("/#/shared/")
    guarded.post("/api/login", json={"token": token})
    assert guarded.get("/api/me").json()["role"] == "admin"
    assert guarded.get("/api/flights").status_code == 200


def test_strangers_cannot_push_out_what_others_did(tmp_path: Path) -> None:
    audit = Audit(tmp_path / "audit.jsonl", tmp_path / "refusals.jsonl")
    audit.note("anna", "operator", "1", "DELETE", "/api/flights/x", 200)
    for number in range(20_000):
        audit.note("", "", str(number), "POST", "/api/" + "x" * 60_000, 401)
    audit.flush()
    assert len((tmp_path / "audit.jsonl").read_text().splitlines()) == 1
    assert (tmp_path / "refusals.jsonl").stat().st_size < 50_000
    with (tmp_path / "audit.jsonl").open("a") as file:
        file.write('{"who": "an')
    assert "anna" in {line["who"] for line in audit.last(1000)}


def test_refusals_of_a_minute_have_a_few_lines_and_a_count(tmp_path: Path) -> None:
    now = [0.0]
    audit = Audit(tmp_path / "audit.jsonl", tmp_path / "refusals.jsonl", lambda: now[0])

    def told() -> list[tuple[str, int, int]]:
        audit.flush()
        lines = [json.loads(line) for line in (tmp_path / "refusals.jsonl").read_text().splitlines()]
        return [(one["who"], one["status"], one.get("count", 1)) for one in lines]

    for _ in range(1000):
        audit.note("link to x", "viewer", "2", "DELETE", "/api/flights/x", 403)
    audit.note("olga", "operator", "1", "DELETE", "/api/flights/nope", 404)
    assert told() == [("link to x", 403, 1)] * 5 + [("olga", 404, 1)]
    now[0] = 61.0
    audit.note("link to x", "viewer", "2", "POST", "/api/logout", 204)
    assert told()[6:] == [("link to x", 403, 995), ("link to x", 204, 1)]
    for _ in range(10):
        audit.note("link to x", "viewer", "2", "POST", "/api/logout", 204)
    audit.close()
    assert told()[12:] == [("link to x", 204, 6)]


def test_a_link_cannot_push_changes_out_of_the_log(bench: Bench, guarded: httpx.Client) -> None:
    flight = bench.record(1, 3, 10**18)
    link = guarded.post(f"/api/flights/{flight}/share", json={}, headers=by(TOKEN)).json()["path"].rpartition("/")[2]
    for _ in range(100):
        problem(guarded.delete(f"/api/flights/{flight}", headers=by(link)), 403)
        assert guarded.post("/api/logout", headers=by(link)).status_code == 204
    bench.app.state.access.audit.flush()
    assert len(bench.settings.audit.read_text().splitlines()) == 1
    assert len(bench.settings.refusals.read_text().splitlines()) == 5
    shown = guarded.get("/api/audit", headers=by(TOKEN)).json()
    assert [one["path"].rpartition("/")[2] for one in shown][-1] == "share"
    (change,) = guarded.get("/api/audit?changes=true", headers=by(TOKEN)).json()
    assert (change["path"], change["count"]) == (f"/api/flights/{flight}/share", 1)


def test_nobody_who_may_change_things_can_push_changes_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.access.audit._MOST_BYTES", 2000)
    now = [0.0]
    audit = Audit(tmp_path / "audit.jsonl", tmp_path / "refusals.jsonl", lambda: now[0])
    audit.note("anna", "admin", "1", "DELETE", "/api/vehicles/x", 204)
    for again in range(1000):
        for path in ("/api/logout", "/api/login", "/api/vehicles/check", "/api/vehicles/inertia"):
            audit.note("olga", "operator", "1", "POST", path, 200)
        audit.note("olga", "operator", "1", "POST", "/api/flights/y/restore", 200)
        audit.note("olga", "operator", "1", "POST", f"/api/flights/{again}/restore/", 307)
    assert len(audit.last(10_000, changes_alone=True)) == 1 + 20
    # Changes that differ have a line each, whatever there were, and no file of them ever goes.
    for number in range(200):
        audit.note("olga", "operator", "1", "DELETE", f"/api/flights/{number}", 204)
    now[0] = 61.0
    found = audit.last(10_000, changes_alone=True)
    assert [one["path"] for one in found if one["who"] == "anna"] == ["/api/vehicles/x"]
    assert {f"/api/flights/{number}" for number in range(200)} <= {one["path"] for one in found}
    assert sum(one.get("count", 1) for one in found if one["path"].endswith("restore")) == 1000
    assert len(list(tmp_path.glob("audit*.jsonl"))) > 5
    assert len(audit.last(3, changes_alone=True)) == 3


def test_lines_are_written_by_nobody_who_is_asked_and_none_is_lost_at_the_end(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, by_threads = threading.Event(), set[str]()
    append = _File.append

    def slow(file: _File, line: dict[str, Any]) -> None:
        held.wait()
        by_threads.add(threading.current_thread().name)
        append(file, line)

    monkeypatch.setattr(_File, "append", slow)
    flight = bench.record(1, 3, 10**18)
    with serving(bench.app) as client:
        for number in range(30):
            answer = client.patch(f"/api/flights/{flight}", json={"title": str(number)}, headers=by(TOKEN))
            assert answer.status_code == 200  # while the disk hangs
        held.set()
    lines = [json.loads(line) for line in bench.settings.audit.read_text().splitlines()]
    assert sum(one.get("count", 1) for one in lines) == 30
    assert by_threads == {"audit"}


def test_wrong_tokens_have_to_wait(bench: Bench, guarded: httpx.Client) -> None:
    anna = TokenFile(bench.settings.tokens).add("anna", "viewer")
    assert guarded.get("/api/flights", headers=by(anna)).status_code == 200
    # The same one again and again, as of a page whose token was revoked, is one.
    again = [guarded.get("/api/flights", headers=by("wrong")).status_code for _ in range(MOST + 2)]
    assert again == [401] * (MOST + 2)
    answers = [guarded.get("/api/flights", headers=by(f"wrong{k}")).status_code for k in range(MOST + 1)]
    assert answers == [401] * (MOST - 1) + [429] * 2
    late = guarded.get("/api/flights", headers=by("wrong"))
    assert "too many wrong tokens" in problem(late, 429)
    assert 0 < int(late.headers["retry-after"]) <= 60
    # Good ones that never came before pass, of every kind, whatever others at their address try.
    bert = TokenFile(bench.settings.tokens).add("bert", "operator")
    flight = bench.record(1, 3, 10**18)
    link = guarded.post(f"/api/flights/{flight}/share", json={}, headers=by(bert)).json()["path"].rpartition("/")[2]
    for good, url in ((anna, "/api/flights"), (TOKEN, "/api/flights"), (link, f"/api/flights/{flight}")):
        assert guarded.get(url, headers=by(good)).status_code == 200
        assert guarded.post("/api/login", json={"token": good}).status_code == 200
    guarded.cookies.clear()
    problem(guarded.post("/api/login", json={"token": "wrong-again"}), 429)
    assert guarded.get("/api/health").status_code == 200


def test_who_waited_is_heard_again_and_others_are_not_held_up() -> None:
    now = [0.0]
    failures = Failures(lambda: now[0])
    for number in range(MOST):
        failures.count("10.0.0.1", bytes([number]))
    assert failures.wait_s("10.0.0.1") == pytest.approx(60.0)
    assert failures.wait_s("10.0.0.2") == 0.0
    now[0] = 61.0
    assert failures.wait_s("10.0.0.1") == 0.0


def test_the_log_says_who_did_what_and_holds_no_token(bench: Bench, guarded: httpx.Client) -> None:
    operator = TokenFile(bench.settings.tokens).add("olga", "operator")
    guarded.get("/api/flights", headers=by(operator))
    guarded.delete("/api/flights/nope", headers=by(operator))
    guarded.delete("/api/vehicles/nope", headers=by(operator))
    guarded.get("/api/flights", headers=by("wrong-token"))
    guarded.post("/api/login", json={"token": operator})
    guarded.cookies.clear()
    lines: list[dict[str, Any]] = guarded.get("/api/audit", headers=by(TOKEN)).json()
    shown = [(one["who"], one["role"], one["method"], one["path"], one["status"]) for one in reversed(lines)]
    assert shown == [
        ("olga", "operator", "DELETE", "/api/flights/nope", 404),
        ("olga", "operator", "DELETE", "/api/vehicles/nope", 403),
        ("", "", "GET", "/api/flights", 401),
        ("olga", "operator", "POST", "/api/login", 200),
    ]
    for path in bench.settings.data.rglob("*"):
        if path.is_file():
            body = path.read_bytes()
            assert operator.encode() not in body, path
            assert b"wrong-token" not in body, path


def test_the_least_role_goes_by_what_an_operation_touches() -> None:
    assert least_role("GET", "/api/flights") is Role.VIEWER
    assert least_role("POST", "/api/flights") is Role.OPERATOR
    assert least_role("GET", "/api/vehicles/x/toml") is Role.VIEWER
    assert least_role("PUT", "/api/vehicles/x") is Role.ADMIN
    assert least_role("GET", "/api/auditorium") is Role.VIEWER  # a name that begins alike is another


def test_a_link_shows_its_flight_where_no_token_is_asked_for(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    with serving(bench.app) as client:
        flight = bench.record(1, 3, 10**18)
        path = client.post(f"/api/flights/{flight}/share", json={"days": 2}).json()["path"]
        token = path.rpartition("/")[2]
        seen = client.post("/api/login", json={"token": token})
        assert seen.json()["flight"] == flight
        assert "set-cookie" not in seen.headers
        assert problem(client.post("/api/login", json={"token": token[:-2] + "xx"}), 401)


def test_places_that_were_taken_are_refusals_and_a_break_in_the_middle_is_none(tmp_path: Path) -> None:
    audit = Audit(tmp_path / "audit.jsonl", tmp_path / "refusals.jsonl")
    for status in (201, 503, 507, 500, 422):
        audit.note("anna", "operator", "1", "POST", "/api/flights", status)
    assert [line["status"] for line in audit.last(10, changes_alone=True)] == [500, 201]


def test_a_log_that_is_closed_without_a_line_is_read_all_the_same(tmp_path: Path) -> None:
    audit = Audit(tmp_path / "audit.jsonl", tmp_path / "refusals.jsonl")
    audit.close()
    audit.close()
    assert audit.last(10) == []
