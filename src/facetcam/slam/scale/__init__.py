"""The metre: hand-overs from view to view, and the scale of the map that they bear out."""
