"""What a person writes, and the world with its truth that comes of it."""
