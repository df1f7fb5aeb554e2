"""What it costs to send work away."""
