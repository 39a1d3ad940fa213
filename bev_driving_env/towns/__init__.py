"""Towns: authored as highway-env road networks, compiled once into flat arrays."""
