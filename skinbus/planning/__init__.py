"""Schedulability of an arm: loads, worst-case response times, ages."""
