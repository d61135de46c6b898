"""Pressures to contacts: pure functions on arrays, kernels compiled by numba."""

from skinbus.estimate.contacts import LEVELS, Contact, Contacts, Quality
from skinbus.estimate.pipeline import Estimator

__all__ = ["LEVELS", "Contact", "Contacts", "Estimator", "Quality"]
