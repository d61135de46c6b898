"""Skins that are not CANopen: their frames become the readings of CANopen patches."""
