"""From a recording to the signals of one flight."""
