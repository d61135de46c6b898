"""Contacts over time: tracker, filter, assignment."""
