"""Hard cases: a table of them, what must hold in each, and the measurements behind docs/hard-cases.md."""
