"""What is on the wire: EDS loading, names and numbers, PDO plans, readings and contacts to bytes and back."""
