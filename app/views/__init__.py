"""The middle of the window: requests for pictures, the mosaic they are laid out on, the image view."""
