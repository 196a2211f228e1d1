"""Onboard logs of autopilots as recordings: their own messages become the standard MAVLink ones nearest to them."""
