"""The modes of the app: each a folder with its panels, and what they all share."""
