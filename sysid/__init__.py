"""System identification on arrays: no sockets, no MAVLink, no web."""
