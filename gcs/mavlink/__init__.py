"""MAVLink: dialects, frames in a stream of bytes, their fields as columns, counters and signatures."""
