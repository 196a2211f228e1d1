"""The station while it runs: receiving, recording, forwarding, keeping time; and sending a recording again."""
