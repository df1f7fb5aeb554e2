"""Pictures of an ordinary colour camera of the same scenes."""
