"""What programs use: one interface to contacts, whether they come from a bus, a log or a simulation."""
