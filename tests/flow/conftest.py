"""Every test of this folder flies, records and identifies whole flights."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The mark of whole flights on what stands here; the hook is given the tests of the other folders as well."""
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.whole_flight)
