"""What people look at; an ordinary listener on the bus."""
