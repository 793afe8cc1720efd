"""A sensor as a component: stamped and sampled for a link, or seen at once on a connection."""
