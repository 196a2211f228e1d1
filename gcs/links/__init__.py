"""Links: bytes with their times of arrival from UDP, TCP and serial devices, and bytes back to them."""
