"""Scan, configure, node-IDs by LSS, and the SDO and LSS sessions they share."""
