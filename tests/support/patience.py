"""How long a test waits for what must come: it goes on when it comes, and gives up where no busy machine gets to."""

#: Half of what pytest allows a test (pyproject.toml), so that one wait in vain is told by its own words.
PATIENCE_S = 300.0
