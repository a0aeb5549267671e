"""The motion between two frames, from corners that no map knows yet."""
