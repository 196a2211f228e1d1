"""The catalogue's tables, and its longer questions."""

SCHEMA = """
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
"""
# Columns that came later: name, and how it is declared.
LATER_COLUMNS = (("parts", "INTEGER NOT NULL DEFAULT 1"), ("deleted_ns", "INTEGER"), ("vehicle_s", "REAL"))

# Every model, newest first. flight_name: what an upload was called. verdict: of a comparison.
MODELS = """
SELECT m.id, m.flight_id, m.kind, m.job_id, m.name, m.created_ns,
    CASE f.source WHEN 'upload' THEN f.name END AS flight_name,
    CASE m.kind WHEN 'discrepancy' THEN json_extract(r.json, '$.verdict') END AS verdict
FROM models AS m LEFT JOIN flights AS f ON f.id = m.flight_id LEFT JOIN results AS r ON r.job_id = m.job_id
ORDER BY m.number DESC
"""
