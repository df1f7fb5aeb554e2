"""Training the rival `yolo` on rendered pictures of rooms, cameras and balls that are drawn anew each time."""
