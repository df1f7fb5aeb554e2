"""YOLOv4-tiny on the pictures of a colour camera. Its modules need torch: nothing here imports them."""
