"""Speed and memory of imports and of slices out of long recordings."""
