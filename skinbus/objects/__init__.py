"""What is on the wire: COB-IDs, EDS files, PDO mapping, readings and contacts as bytes."""
