"""The mark of every page that this program writes to a file."""

GENERATOR = '<meta name="generator" content="flight-model-ground-station">'
