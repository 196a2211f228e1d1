"""Recordings: MCAP files that every MCAP tool opens and from which each link's byte stream can be rebuilt."""
