"""The only place that touches the outside: interfaces, the in-process wire, recordings, clocks."""
