"""Tables of rows: gathered per topic, joined, and as the frames of other packages."""
