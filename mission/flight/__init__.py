"""Pure: observation in, command out."""
