"""The tables of the catalogue's file, and what files of earlier versions lack of them."""

from __future__ import annotations

import sqlite3

_SCHEMA = """
CREATE TABLE IF NOT EXISTS flights (
    id TEXT PRIMARY KEY, file TEXT NOT NULL, name TEXT NOT NULL, source TEXT NOT NULL, state TEXT NOT NULL,
    system INTEGER, start_ns INTEGER NOT NULL, end_ns INTEGER NOT NULL, messages INTEGER NOT NULL,
    bytes INTEGER NOT NULL, end_reason TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS flights_by_start ON flights (start_ns DESC, id DESC);
CREATE TABLE IF NOT EXISTS jobs (
    number INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT UNIQUE NOT NULL, flight_id TEXT NOT NULL,
    kind TEXT NOT NULL, request TEXT NOT NULL, state TEXT NOT NULL, progress REAL NOT NULL, error TEXT,
    attempts INTEGER NOT NULL, created_ns INTEGER NOT NULL, started_ns INTEGER, ended_ns INTEGER);
CREATE TABLE IF NOT EXISTS job_log (
    number INTEGER PRIMARY KEY AUTOINCREMENT, job_id TEXT NOT NULL, at_ns INTEGER NOT NULL, line TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS job_log_by_job ON job_log (job_id, number);
CREATE TABLE IF NOT EXISTS results (
    number INTEGER PRIMARY KEY AUTOINCREMENT, flight_id TEXT NOT NULL, kind TEXT NOT NULL, job_id TEXT NOT NULL,
    created_ns INTEGER NOT NULL, json TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS results_by_flight ON results (flight_id, kind, number DESC);
CREATE TABLE IF NOT EXISTS models (
    number INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT UNIQUE NOT NULL, flight_id TEXT NOT NULL, kind TEXT NOT NULL,
    job_id TEXT NOT NULL, name TEXT NOT NULL, created_ns INTEGER NOT NULL, json TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS flight_notes (
    flight_id TEXT PRIMARY KEY, title TEXT NOT NULL, comment TEXT NOT NULL, tags TEXT NOT NULL, vehicle TEXT NOT NULL,
    changed_ns INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS flight_outlines (flight_id TEXT PRIMARY KEY, json TEXT NOT NULL);
"""
# Columns that came later: table, name, and how it is declared.
_LATER_COLUMNS = (
    ("flights", "parts", "INTEGER NOT NULL DEFAULT 1"),
    ("flights", "deleted_ns", "INTEGER"),
    ("flights", "vehicle_s", "REAL"),
    ("flights", "discarded_ns", "INTEGER"),
    ("flights", "follows", "TEXT"),
    ("flights", "settled", "INTEGER NOT NULL DEFAULT 0"),
    ("flights", "board", "TEXT"),
    ("jobs", "priority", "INTEGER NOT NULL DEFAULT 1"),
    ("jobs", "cpu_s", "REAL"),
    ("jobs", "peak_bytes", "INTEGER"),
    ("jobs", "owner", "TEXT NOT NULL DEFAULT ''"),
    ("results", "verdict", "TEXT"),
    ("results", "reason", "TEXT"),
    ("models", "verdict", "TEXT"),
    ("models", "found", "TEXT"),
)
# What results and models that were stored before these columns would have in them.
_FILLED_RESULTS = """
UPDATE results SET verdict = json_extract(json, '$.quality.verdict'),
    reason = json_extract(json, '$.quality.reasons[0]')
WHERE json_valid(json)
"""
_FILLED = """
UPDATE models SET verdict = json_extract(results.json, '$.verdict'),
    found = (SELECT json_group_array(json_extract(value, '$.name')) FROM json_each(results.json, '$.effects'))
FROM results WHERE results.job_id = models.job_id AND models.kind = 'discrepancy' AND json_valid(results.json)
"""


def prepare(db: sqlite3.Connection) -> None:
    """Make the tables that are not there, and add to those of an earlier version what they lack."""
    db.executescript(_SCHEMA)
    added = [name for table, name, declared in _LATER_COLUMNS if _add(db, table, name, declared)]
    if "reason" in added:
        db.execute(_FILLED_RESULTS)
    if "found" in added:
        db.execute(_FILLED)


def _add(db: sqlite3.Connection, table: str, name: str, declared: str) -> bool:
    if name in {row[1] for row in db.execute(f"PRAGMA table_info({table})")}:
        return False
    db.execute(f"ALTER TABLE {table} ADD COLUMN {name} {declared}")
    return True
