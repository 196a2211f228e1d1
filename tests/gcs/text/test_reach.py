"""How others on the network reach the service."""

import ipaddress

from gcs.text.reach import own_addresses, qr_code, reachable


def test_only_who_listens_everywhere_has_further_addresses() -> None:
    found = ["192.168.1.5", "fd00::5"]
    assert reachable("http://0.0.0.0:8126", found) == ["http://192.168.1.5:8126", "http://[fd00::5]:8126"]
    assert reachable("http://[::]:8126", found) == ["http://192.168.1.5:8126", "http://[fd00::5]:8126"]
    assert reachable("http://127.0.0.1:8126", found) == []
    assert reachable("http://192.168.1.5:8126", found) == []


def test_own_addresses_are_addresses() -> None:
    assert all(ipaddress.ip_address(one) for one in own_addresses())


def test_a_code_in_a_terminal_is_the_url() -> None:
    """Read back from its characters: each holds two modules, one above the other."""
    import segno

    url = "http://192.168.1.5:8126"
    lines = [line for line in qr_code(url).split("\n") if line]
    dark = {"█": (0, 0), "▀": (0, 1), "▄": (1, 0), " ": (1, 1)}
    plain = [[dark[sign] for sign in line if sign in dark] for line in lines]
    rows = [[pair[half] for pair in line] for line in plain for half in (0, 1)]
    border, code = 4, segno.make(url, micro=False)
    size = code.symbol_size(border=0)[0]
    inner = [row[border : border + size] for row in rows[border : border + size]]
    assert inner == [list(row) for row in code.matrix]
