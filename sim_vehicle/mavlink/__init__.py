"""MAVLink: telemetry, services, faulty links, several vehicles."""
