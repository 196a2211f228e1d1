"""What the tests of other readers share."""

import pytest
from node_reader import NodeReader


@pytest.fixture(scope="session")
def node(tmp_path_factory: pytest.TempPathFactory) -> NodeReader:
    """The viewers' libraries, installed once."""
    return NodeReader.installed(tmp_path_factory.mktemp("node"))
