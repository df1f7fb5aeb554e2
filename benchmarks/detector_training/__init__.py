"""Training of `yolo` on rendered pictures with random backgrounds, cameras and balls."""
