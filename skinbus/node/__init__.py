"""A CANopen device without I/O, clock or thread: NMT, SDO server, PDO engine, EMCY, heartbeat."""
