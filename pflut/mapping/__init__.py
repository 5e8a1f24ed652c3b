"""From posteriors to maps: constraints, links, pose graphs."""
