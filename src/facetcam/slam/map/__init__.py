"""The map: keyframes, points and places, the way through it, and its file."""
