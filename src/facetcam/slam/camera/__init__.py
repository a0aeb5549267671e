"""The rig as one generalised camera: its optics, its frames, and the pose of a frame from known points."""
