"""A built-in room, its lamps, a renderer that looks through mirrors, and a robot that drives."""
