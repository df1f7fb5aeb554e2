"""The middle of the window: picture requests, mosaics, and the image view."""
