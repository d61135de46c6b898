"""The master: boots and supervises patches, gathers a cycle, estimates, publishes contacts."""
