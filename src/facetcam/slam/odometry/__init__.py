"""What wheels say of the way, and whether they may be believed."""
