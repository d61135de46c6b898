"""What a CAN frame is, no I/O: frame, core, clock, bit timing, arbitration, virtual bus, candump text."""
