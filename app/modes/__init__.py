"""The modes of the app, one room each; `factories` knows them by name."""
