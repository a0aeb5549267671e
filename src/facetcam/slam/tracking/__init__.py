"""Where the rig is in the map, frame by frame, and which poses are believed."""
