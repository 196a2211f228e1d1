"""What a recording holds, for people and as JSON."""
