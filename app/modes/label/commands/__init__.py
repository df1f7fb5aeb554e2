"""What a person may ask for in Label: frozen commands, each a pure step of the labelling."""
