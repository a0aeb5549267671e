"""Whether the rig's file and the film belong together, and how the one would fit the other better."""
