"""The map from its start: new keyframes and points, loops, and several maps made one."""
